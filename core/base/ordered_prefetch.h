#pragma once

#include <fmt/format.h>

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/parallel_for.h"

namespace volalign {

/// An endless stream of items that worker threads produce ahead of its reader. Items are functions
/// of their index, and come in the order of the index for any number of threads (as from
/// torch.utils.data.DataLoader). `Item` is default constructible and movable.
template <class Item>
class OrderedPrefetch {
 public:
  struct Options {
    std::uint64_t first_index = 0;
    /// Consecutive items that the reader takes together, beginning at multiples of batch_size.
    int batch_size = 1;
    /// Most batches that are begun but not taken: this bounds the memory. A batch is taken with its
    /// last item.
    int prefetch = 4;
    int num_threads = 1;
  };
  using Produce = std::function<Item(std::uint64_t index)>;

  /// Each worker calls `make_produce` before its first item, possibly several at a time. The result
  /// lives on that thread alone and is destroyed there, so it may own a GL context. Fewer threads
  /// work if the system gives no more. Throws Error for options below 1, and if the system gives no
  /// thread at all.
  OrderedPrefetch(const Options& options, std::function<Produce()> make_produce)
      : options_(options),
        make_produce_(std::move(make_produce)),
        next_(options.first_index),
        out_(options.first_index) {
    if (options.batch_size < 1 || options.prefetch < 1 || options.num_threads < 1) {
      throw Error(fmt::format(
          "OrderedPrefetch: batch_size = {}, prefetch = {}, num_threads = {} violate >= 1",
          options.batch_size, options.prefetch, options.num_threads));
    }
    const auto wanted = static_cast<std::size_t>(options.num_threads);
    if (StartThreads(
            wanted, [this] { Work(); }, &threads_) == 0) {
      throw Error(
          "no thread can be started: raise the limit of processes (ulimit -u), or end others");
    }
  }
  /// Waits for the items in work and begins no others.
  ~OrderedPrefetch() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    room_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }
  OrderedPrefetch(const OrderedPrefetch&) = delete;
  OrderedPrefetch& operator=(const OrderedPrefetch&) = delete;

  /// The next item, waiting for it; for one thread at a time. Rethrows an exception of
  /// `make_produce` or of the producer for this item, and again in every later call.
  Item Take() {
    std::unique_lock<std::mutex> lock(mutex_);
    finished_.wait(lock, [this] { return done_.count(out_) > 0; });
    const auto it = done_.find(out_);
    if (it->second.failure) std::rethrow_exception(it->second.failure);
    Item item = std::move(it->second.item);
    done_.erase(it);
    const bool room = ++out_ % static_cast<std::uint64_t>(options_.batch_size) == 0;
    lock.unlock();
    if (room) room_.notify_all();
    return item;
  }

 private:
  struct Done {
    Item item;
    std::exception_ptr failure;
  };

  void Work() {
    Produce produce;
    std::uint64_t index = 0;
    while (Claim(&index)) {
      Done done;
      try {
        if (!produce) produce = make_produce_();
        done.item = produce(index);
      } catch (...) {
        done.failure = std::current_exception();
      }
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        done_[index] = std::move(done);
      }
      finished_.notify_all();
    }
  }

  /// Waits for room and takes the next index. False if the stream ends.
  bool Claim(std::uint64_t* index) {
    std::unique_lock<std::mutex> lock(mutex_);
    const auto batch_size = static_cast<std::uint64_t>(options_.batch_size);
    const auto prefetch = static_cast<std::uint64_t>(options_.prefetch);
    room_.wait(lock, [&] { return stop_ || next_ / batch_size < out_ / batch_size + prefetch; });
    if (stop_) return false;
    *index = next_++;
    return true;
  }

  const Options options_;
  const std::function<Produce()> make_produce_;
  std::mutex mutex_;
  std::condition_variable room_;      // a batch was taken, or the stream ends
  std::condition_variable finished_;  // an item is in done_
  std::map<std::uint64_t, Done> done_;
  std::uint64_t next_, out_;  // to be begun, to be taken
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace volalign
