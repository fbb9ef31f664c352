#include "core/nn/cpu/torch_threads.h"

#include <ATen/Parallel.h>

#include <string>

#include "core/base/error.h"

namespace volalign {

void SetTorchThreads(int threads) {
  if (threads < 0) {
    throw Error("SetTorchThreads: " + std::to_string(threads) +
                " threads; a positive number is expected, or 0 to leave it as it is");
  }
  if (threads > 0) at::set_num_threads(threads);
}

// at::parallel_for is a template that is compiled here: without -fopenmp it is a plain loop.
void ForEachOnTorchThreads(std::int64_t count, const std::function<void(std::int64_t)>& task) {
  at::parallel_for(0, count, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) task(i);
  });
}

}  // namespace volalign
