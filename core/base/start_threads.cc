#include "core/base/start_threads.h"

#include <system_error>

namespace volalign {

std::size_t StartThreads(std::size_t count, const std::function<void()>& work,
                         std::vector<std::thread>* threads) {
  threads->reserve(threads->size() + count);
  for (std::size_t i = 0; i < count; ++i) {
    try {
      threads->emplace_back(work);
    } catch (const std::system_error&) {
      return i;
    }
  }
  return count;
}

}  // namespace volalign
