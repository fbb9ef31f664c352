#pragma once

#include <cstddef>
#include <functional>

namespace volalign {

/// Runs task(0), ..., task(count - 1) on `threads` threads and rethrows the first exception.
void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& task);

}  // namespace volalign
