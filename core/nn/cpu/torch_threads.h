#pragma once

#include <cstdint>
#include <functional>

namespace volalign {

/// Sets the number of threads on which LibTorch runs one operation, for the whole process; 0 leaves
/// it as it is. That is the program's to decide and no library's, since a process has one such
/// number: call it once, before a network is used. Debian's LibTorch starts with one thread. Throws
/// Error for a negative number.
void SetTorchThreads(int threads);

/// Calls task(0), ..., task(count - 1) on the threads on which LibTorch runs one operation
/// (SetTorchThreads): on one alone where this build has no OpenMP, or where a task or an operation
/// of LibTorch calls it. Rethrows the first exception.
void ForEachOnTorchThreads(std::int64_t count, const std::function<void(std::int64_t)>& task);

}  // namespace volalign
