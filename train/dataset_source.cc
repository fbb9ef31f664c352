#include "train/dataset_source.h"

#include <fmt/format.h>

#include <numeric>
#include <utility>

#include "core/base/error.h"
#include "core/base/ordered_prefetch.h"
#include "core/base/random.h"

namespace volalign {
namespace {

/// Batches begin at multiples of the batch size, where image sizes change.
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

namespace {

/// Reads the stream's batches, at rising positions. One per thread, as it keeps the order of the
/// last epoch.
class BatchReader {
 public:
  BatchReader(std::shared_ptr<const Dataset> dataset, const DatasetOrder& options)
      : dataset_(std::move(dataset)),
        seed_(options.seed),
        batch_size_(options.batch_size),
        slice_(options.slice),
        batches_per_epoch_(CountBatches(*dataset_, batch_size_)),
        first_batch_(FirstBatch(dataset_->header(), batch_size_)) {}

  std::vector<Sample> operator()(std::uint64_t position) {
    const std::uint64_t batch =
        first_batch_ + InEpoch(position / batches_per_epoch_, position % batches_per_epoch_);
    return dataset_->Read(
        batch * static_cast<std::uint64_t>(batch_size_) + static_cast<std::uint64_t>(slice_.first),
        slice_.count > 0 ? slice_.count : batch_size_);
  }

 private:
  std::uint64_t InEpoch(std::uint64_t epoch, std::uint64_t position) {
    if (epoch == 0) return position;
    if (epoch != order_epoch_) {
      order_.resize(batches_per_epoch_);
      std::iota(order_.begin(), order_.end(), 0u);
      RandomStream random(seed_, epoch, "dataset_order");
      for (std::size_t i = order_.size(); i > 1; --i) {  // Fisher and Yates
        std::swap(order_[i - 1],
                  order_[static_cast<std::size_t>(random.Below(static_cast<int>(i)))]);
      }
      order_epoch_ = epoch;
    }
    return order_[position];
  }

  std::shared_ptr<const Dataset> dataset_;
  std::uint64_t seed_;
  int batch_size_;
  BatchSlice slice_;
  std::uint64_t batches_per_epoch_, first_batch_;
  std::uint64_t order_epoch_ = 0;
  std::vector<std::uint32_t> order_;
};

}  // namespace

SampleSource DatasetSamples(std::shared_ptr<const Dataset> dataset, const DatasetOrder& options) {
  const auto size = static_cast<std::uint64_t>(options.batch_size);
  if (options.batch_size < 1 || options.first_sample % size != 0) {
    throw Error(
        fmt::format("DatasetSamples: first_sample = {} is not a multiple of the batch size {}",
                    options.first_sample, options.batch_size));
  }
  using Batches = OrderedPrefetch<std::vector<Sample>>;
  const auto batches = std::make_shared<Batches>(
      Batches::Options{options.first_sample / size, 1, options.prefetch, options.num_threads},
      [reader = BatchReader(std::move(dataset), options)] { return reader; });
  return [batches] { return batches->Take(); };
}

}  // namespace volalign
