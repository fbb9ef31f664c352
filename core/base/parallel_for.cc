#include "core/base/parallel_for.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>

#include "core/base/stop.h"

namespace volalign {

void ParallelFor(std::size_t count, int threads, const std::function<void(std::size_t)>& task) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex mutex;
  const std::atomic<bool>* const asked = StopScope::Current();
  const auto work = [&] {
    const StopScope scope(asked);
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        ThrowIfStopped();
        task(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!failure) failure = std::current_exception();
      }
    }
  };
  std::vector<std::thread> helpers;
  const std::size_t wanted = std::min(count, static_cast<std::size_t>(std::max(threads, 1)));
  StartThreads(wanted - std::min<std::size_t>(wanted, 1), work, &helpers);
  work();
  for (std::thread& helper : helpers) helper.join();
  if (failure) std::rethrow_exception(failure);
}

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
