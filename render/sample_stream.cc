#include "render/sample_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <thread>

#include "core/error.h"
#include "render/depth_renderer.h"
#include "render/egl_context.h"

namespace volalign {

class SampleStream::Impl {
 public:
  Impl(std::shared_ptr<const SampleContext> context, const Options& options)
      : context_(std::move(context)), options_(options) {
    if (context_ == nullptr) throw Error("SampleStream: no context");
    if (options.num_threads < 1 || options.prefetch < 1) {
      throw Error(
          fmt::format("SampleStream: num_threads = {} and prefetch = {} violate num_threads >= 1, "
                      "prefetch >= 1",
                      options.num_threads, options.prefetch));
    }
    batch_size_ = static_cast<std::uint64_t>(context_->batch_size);
    if (options.first_index % batch_size_ != 0) {
      throw Error(
          fmt::format("SampleStream: first_index = {} is not a multiple of the batch size {}",
                      options.first_index, batch_size_));
    }
    next_index_ = options.first_index;
    out_batch_ = options.first_index / batch_size_;
    for (int i = 0; i < options.num_threads; ++i) threads_.emplace_back([this] { Work(); });
  }

  ~Impl() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = true;
    }
    room_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  std::vector<Sample> Next() {
    std::unique_lock<std::mutex> lock(mutex_);
    finished_.wait(lock, [this] {
      const auto it = batches_.find(out_batch_);
      return thread_failure_ ||
             (it != batches_.end() && (it->second.failure || it->second.done == batch_size_));
    });
    const auto it = batches_.find(out_batch_);
    const bool complete = it != batches_.end() && it->second.done == batch_size_;
    if (it != batches_.end() && it->second.failure) std::rethrow_exception(it->second.failure);
    if (!complete) std::rethrow_exception(thread_failure_);
    std::vector<Sample> samples = std::move(it->second.samples);
    batches_.erase(it);
    ++out_batch_;
    lock.unlock();
    room_.notify_all();
    return samples;
  }

 private:
  struct Batch {
    std::vector<Sample> samples;
    std::uint64_t done = 0;
    std::exception_ptr failure;
  };

  void Work() {
    try {
      EglContextOptions egl_options;
      egl_options.device = options_.device;
      const EglContext egl(egl_options);
      DepthRenderer renderer;
      std::uint64_t index = 0;
      while (Claim(&index)) {
        try {
          Deliver(index, Synthesize(*context_, renderer, options_.seed, index));
        } catch (...) {
          Fail(index, std::current_exception());
        }
      }
    } catch (...) {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        thread_failure_ = std::current_exception();
      }
      finished_.notify_all();
    }
  }

  /// Takes the next sample index; waits while `prefetch` batches are ahead of the caller. False
  /// when the stream ends.
  bool Claim(std::uint64_t* index) {
    std::unique_lock<std::mutex> lock(mutex_);
    room_.wait(lock, [this] {
      return stop_ ||
             next_index_ / batch_size_ < out_batch_ + static_cast<std::uint64_t>(options_.prefetch);
    });
    if (stop_) return false;
    *index = next_index_++;
    return true;
  }

  void Deliver(std::uint64_t index, Sample sample) {
    bool complete = false;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      Batch& batch = batches_[index / batch_size_];
      batch.samples.resize(batch_size_);
      batch.samples[index % batch_size_] = std::move(sample);
      complete = ++batch.done == batch_size_;
    }
    if (complete) finished_.notify_all();
  }

  void Fail(std::uint64_t index, std::exception_ptr failure) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      batches_[index / batch_size_].failure = std::move(failure);
    }
    finished_.notify_all();
  }

  std::shared_ptr<const SampleContext> context_;
  Options options_;
  std::uint64_t batch_size_ = 1;
  std::mutex mutex_;
  std::condition_variable room_;      // a batch was taken, or the stream stops
  std::condition_variable finished_;  // a batch is complete, or something failed
  std::map<std::uint64_t, Batch> batches_;
  std::uint64_t next_index_ = 0;
  std::uint64_t out_batch_ = 0;
  std::exception_ptr thread_failure_;
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

SampleStream::SampleStream(std::shared_ptr<const SampleContext> context, const Options& options)
    : impl_(new Impl(std::move(context), options)) {}

SampleStream::~SampleStream() = default;

std::vector<Sample> SampleStream::Next() { return impl_->Next(); }

}  // namespace volalign
