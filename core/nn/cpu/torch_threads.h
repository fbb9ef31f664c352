#pragma once

#include <cstdint>
#include <functional>

namespace volalign {

/// Sets the number of threads on which LibTorch runs one operation, for the whole process; 0 leaves
/// it as it is. A program calls it once, before a network is used. A library does not, as a process
/// has only one such number. Debian's LibTorch starts with one thread. Throws Error for a negative
/// number.
void SetTorchThreads(int threads);

/// Calls task(0), ..., task(count - 1) on the threads on which LibTorch runs one operation
/// (SetTorchThreads). It is one thread if this build has no OpenMP, or if a task or an operation of
/// LibTorch calls it. Rethrows the first exception.
void ForEachOnTorchThreads(std::int64_t count, const std::function<void(std::int64_t)>& task);

}  // namespace volalign
