#pragma once

#include <cstddef>
#include <functional>
#include <thread>
#include <vector>

namespace volalign {

/// Runs task(0), ..., task(count - 1) on `threads` threads, including the calling one. Rethrows the
/// first exception when all have ended. Fewer threads work if the system gives no more. If the
/// caller is asked to stop (core/base/stop.h), so are its threads, and no task begins.
void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& task);

/// Starts up to `count` threads that run `work`, appends them to `threads` and returns their
/// number. There are fewer if the system gives no more. The caller joins them.
std::size_t StartThreads(std::size_t count, const std::function<void()>& work,
                         std::vector<std::thread>* threads);

}  // namespace volalign
