#pragma once

#include <cstddef>
#include <functional>

namespace volalign {

/// Runs task(0), ..., task(count - 1) on `threads` threads, the calling one included, and rethrows
/// the first exception when all have ended. Where the system gives fewer threads, those do the
/// work. Where the caller is asked to stop (core/base/stop.h), so are its threads, and no task
/// begins.
void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& task);

}  // namespace volalign
