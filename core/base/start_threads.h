#pragma once

#include <cstddef>
#include <functional>
#include <thread>
#include <vector>

namespace volalign {

/// Starts up to `count` threads that run `work`, appends them to `threads` and returns their
/// number. There are fewer if the system gives no more. The caller joins them.
std::size_t StartThreads(std::size_t count, const std::function<void()>& work,
                         std::vector<std::thread>* threads);

}  // namespace volalign
