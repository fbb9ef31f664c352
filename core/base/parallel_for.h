#pragma once

#include <cstddef>
#include <functional>

namespace volalign {

/// Runs task(0), ..., task(count - 1) on `threads` threads, the calling one included, and rethrows
/// the first exception when all have ended. Where the system gives fewer threads, those do the
/// work.
void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& task);

}  // namespace volalign
