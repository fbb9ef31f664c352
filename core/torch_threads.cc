#include "core/torch_threads.h"

#include <ATen/Parallel.h>

#include <string>

#include "core/error.h"

namespace volalign {

void SetTorchThreads(int threads) {
  if (threads < 0) {
    throw Error("SetTorchThreads: " + std::to_string(threads) +
                " threads; a positive number is expected, or 0 to leave it as it is");
  }
  if (threads > 0) at::set_num_threads(threads);
}

}  // namespace volalign
