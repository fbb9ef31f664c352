#pragma once

namespace volalign {

/// Sets the number of threads on which LibTorch runs one operation, for the whole process; 0 leaves
/// it as it is. That is the program's to decide and no library's, since a process has one such
/// number: call it once, before a network is used. Debian's LibTorch starts with one thread. Throws
/// Error for a negative number.
void SetTorchThreads(int threads);

}  // namespace volalign
