#include "train/dataset_source.h"

#include <fmt/format.h>

#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <numeric>
#include <thread>
#include <utility>

#include "core/error.h"
#include "core/random.h"

namespace volalign {
namespace {

/// Batches begin at multiples of the batch size, as image sizes change there.
std::uint64_t FirstBatch(const DatasetHeader& header, int batch_size) {
  const auto size = static_cast<std::uint64_t>(batch_size);
  return (header.first_index + size - 1) / size;
}

}  // namespace

std::uint64_t CountBatches(const Dataset& dataset, int batch_size) {
  const DatasetHeader& header = dataset.header();
  if (header.image_sizes.size() > 1 && header.batch_size % batch_size != 0) {
    throw ConfigError(fmt::format(
        "run.batch_size = {} does not divide {}, the batch size of {}, whose image size changes "
        "from batch to batch",
        batch_size, header.batch_size, dataset.dir().string()));
  }
  const std::uint64_t first = FirstBatch(header, batch_size);
  const std::uint64_t last =
      (header.first_index + header.count) / static_cast<std::uint64_t>(batch_size);
  if (last <= first) {
    throw ConfigError(
        fmt::format("{} has {} samples from index {} on: no whole batch of run.batch_size = {}",
                    dataset.dir().string(), header.count, header.first_index, batch_size));
  }
  return last - first;
}

class DatasetSource::Impl {
 public:
  Impl(std::shared_ptr<const Dataset> dataset, const Options& options)
      : dataset_(std::move(dataset)), options_(options) {
    if (dataset_ == nullptr) throw Error("DatasetSource: no dataset");
    if (options.batch_size < 1 || options.num_threads < 1 || options.prefetch < 1) {
      throw Error(fmt::format(
          "DatasetSource: batch_size = {}, num_threads = {}, prefetch = {} violate >= 1",
          options.batch_size, options.num_threads, options.prefetch));
    }
    const auto size = static_cast<std::uint64_t>(options.batch_size);
    if (options.first_sample % size != 0) {
      throw Error(
          fmt::format("DatasetSource: first_sample = {} is not a multiple of the batch size {}",
                      options.first_sample, size));
    }
    batches_per_epoch_ = CountBatches(*dataset_, options.batch_size);
    first_batch_ = FirstBatch(dataset_->header(), options.batch_size);
    next_ = out_ = options.first_sample / size;
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
    finished_.wait(lock, [this] { return done_.count(out_) > 0; });
    const auto it = done_.find(out_);
    if (it->second.failure) std::rethrow_exception(it->second.failure);
    std::vector<Sample> samples = std::move(it->second.samples);
    done_.erase(it);
    ++out_;
    lock.unlock();
    room_.notify_all();
    return samples;
  }

 private:
  struct Done {
    std::vector<Sample> samples;
    std::exception_ptr failure;
  };

  void Work() {
    std::uint64_t position = 0, batch = 0;
    while (Claim(&position, &batch)) {
      Done done;
      try {
        done.samples = dataset_->Read(batch * static_cast<std::uint64_t>(options_.batch_size),
                                      options_.batch_size);
        RequireOneSize(done.samples);
      } catch (...) {
        done.failure = std::current_exception();
      }
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        done_[position] = std::move(done);
      }
      finished_.notify_all();
    }
  }

  /// Takes the next position of the stream and the batch that stands there.
  bool Claim(std::uint64_t* position, std::uint64_t* batch) {
    std::unique_lock<std::mutex> lock(mutex_);
    room_.wait(lock, [this] {
      return stop_ || next_ < out_ + static_cast<std::uint64_t>(options_.prefetch);
    });
    if (stop_) return false;
    *position = next_++;
    *batch = first_batch_ + InEpoch(*position / batches_per_epoch_, *position % batches_per_epoch_);
    return true;
  }

  std::uint64_t InEpoch(std::uint64_t epoch, std::uint64_t position) {
    if (epoch == 0) return position;
    if (epoch != order_epoch_) {
      order_.resize(batches_per_epoch_);
      std::iota(order_.begin(), order_.end(), 0u);
      RandomStream random(options_.seed, epoch, "dataset_order");
      for (std::size_t i = order_.size(); i > 1; --i) {  // Fisher and Yates
        std::swap(order_[i - 1],
                  order_[static_cast<std::size_t>(random.Below(static_cast<int>(i)))]);
      }
      order_epoch_ = epoch;
    }
    return order_[position];
  }

  void RequireOneSize(const std::vector<Sample>& samples) const {
    for (const Sample& s : samples) {
      if (s.intrinsics.width == samples[0].intrinsics.width &&
          s.intrinsics.height == samples[0].intrinsics.height) {
        continue;
      }
      throw DataError(fmt::format("{}: sample {} is {}x{} pixels, sample {} of its batch {}x{}",
                                  dataset_->dir().string(), s.index, s.intrinsics.width,
                                  s.intrinsics.height, samples[0].index,
                                  samples[0].intrinsics.width, samples[0].intrinsics.height));
    }
  }

  const std::shared_ptr<const Dataset> dataset_;
  const Options options_;
  std::uint64_t batches_per_epoch_ = 1, first_batch_ = 0;
  std::mutex mutex_;
  std::condition_variable room_;      // a batch was taken, or the source goes
  std::condition_variable finished_;  // a batch was read
  std::map<std::uint64_t, Done> done_;
  std::uint64_t next_ = 0, out_ = 0;  // positions in the endless stream of batches
  std::uint64_t order_epoch_ = 0;
  std::vector<std::uint32_t> order_;
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

DatasetSource::DatasetSource(std::shared_ptr<const Dataset> dataset, const Options& options)
    : impl_(new Impl(std::move(dataset), options)) {}

DatasetSource::~DatasetSource() = default;

std::vector<Sample> DatasetSource::Next() { return impl_->Next(); }

}  // namespace volalign
