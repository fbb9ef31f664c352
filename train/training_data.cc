#include "train/training_data.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <numeric>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/ordered_prefetch.h"
#include "core/base/random.h"
#include "render/dataset.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "train/real_frames.h"

namespace volalign {
namespace {

/// Batches begin at multiples of the batch size, where image sizes change.
std::uint64_t FirstBatch(const DatasetHeader& header, int batch_size) {
  const auto size = static_cast<std::uint64_t>(batch_size);
  return (header.first_index + size - 1) / size;
}

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

namespace {

/// Samples that a source may give: indices [begin, end) of a seed.
struct Domain {
  std::uint64_t seed, begin, end;
};

Domain DomainOf(const Dataset& dataset) {
  const DatasetHeader& h = dataset.header();
  return {h.seed, h.first_index, h.first_index + h.count};
}

void RequireSameStructure(const char* key, const Dataset& dataset, const SampleContext& context) {
  if (dataset.header().structure.sha256 == context.structure.Hash()) return;
  throw ConfigError(fmt::format(
      "{} = {} shows the structure {} with other boxes or labels than data.structure = {}", key,
      dataset.dir().string(), dataset.header().structure.name, context.config.structure));
}

std::shared_ptr<const Dataset> OpenTrainingSet(const TrainConfig& config,
                                               const SampleContext& context) {
  if (config.run.dataset.empty()) return nullptr;
  auto dataset = std::make_shared<const Dataset>(config.run.dataset);
  RequireSameStructure("run.dataset", *dataset, context);
  const std::vector<std::string> differences = DifferencesFrom(dataset->header(), context);
  if (!differences.empty()) {
    throw ConfigError(fmt::format(
        "run.dataset = {} was drawn from another recipe: {}: train with the recipe that wrote it",
        config.run.dataset, differences[0]));
  }
  CountBatches(*dataset, config.run.batch_size);
  return dataset;
}

std::shared_ptr<const Dataset> OpenValidationSet(const TrainConfig& config,
                                                 const SampleContext& context) {
  if (config.run.validation_dataset.empty() || config.run.validation_samples == 0) return nullptr;
  auto dataset = std::make_shared<const Dataset>(config.run.validation_dataset);
  RequireSameStructure("run.validation_dataset", *dataset, context);
  const std::uint64_t usable = CountBatches(*dataset, config.run.batch_size) *
                               static_cast<std::uint64_t>(config.run.batch_size);
  if (static_cast<std::uint64_t>(config.run.validation_samples) > usable) {
    throw ConfigError(
        fmt::format("run.validation_samples = {} exceeds the {} samples in whole batches of "
                    "run.validation_dataset = {}",
                    config.run.validation_samples, usable, config.run.validation_dataset));
  }
  return dataset;
}

void RequireApart(const TrainConfig& config, const Dataset* training, const Dataset* validation) {
  const RunConfig& run = config.run;
  if (run.validation_samples == 0) return;
  const Domain seen = training ? DomainOf(*training)
                               : Domain{static_cast<std::uint64_t>(run.seed), 0,
                                        static_cast<std::uint64_t>(run.samples)};
  const Domain held = validation ? DomainOf(*validation)
                                 : Domain{static_cast<std::uint64_t>(run.validation_seed), 0,
                                          static_cast<std::uint64_t>(run.validation_samples)};
  if (seen.seed != held.seed || seen.end <= held.begin || held.end <= seen.begin) return;
  throw ConfigError(fmt::format(
      "validation would see training samples: both draw from seed {}, training {} to {}, "
      "validation {} to {}: write one of them with another `volalign render --seed`",
      seen.seed, seen.begin, seen.end - 1, held.begin, held.end - 1));
}

/// Reports at the start, and not hours later at the first validation, that nothing can be rendered.
Renderers RendererOf(const TrainConfig& config, bool only_validates) {
  try {
    return ChooseRenderers(config.data.renderer, {}, config.run.device.rfind("cuda", 0) == 0);
  } catch (const IoError& e) {
    if (!only_validates) throw;
    throw IoError(
        fmt::format("run.dataset needs no renderer, but validation does ({}): name a folder in "
                    "run.validation_dataset, set run.validation_samples=0, or data.renderer=cpu",
                    e.what()));
  }
}

/// Samples of `seed` from a folder, or rendered if there is none.
SampleSource OpenSource(const std::shared_ptr<const Dataset>& dataset,
                        const std::shared_ptr<const SampleContext>& context, const RunConfig& run,
                        const RendererFactory& renderers, std::int64_t seed,
                        std::int64_t first_sample, const BatchSlice& slice) {
  const auto of = static_cast<std::uint64_t>(seed),
             first = static_cast<std::uint64_t>(first_sample);
  if (!dataset) return RenderedSamples(context, run, renderers, of, first, slice);
  return DatasetSamples(dataset, {of, first, run.batch_size, run.loader_threads, slice});
}

/// The frames of a list of calibrations, each of which fits an image size; null for no files.
std::shared_ptr<const std::vector<RealFrame>> OpenRealFrames(const std::vector<std::string>& files,
                                                             const TrainConfig& config,
                                                             const SampleContext& context) {
  if (files.empty()) return nullptr;
  auto frames =
      std::make_shared<const std::vector<RealFrame>>(ReadRealFrames(files, context.structure));
  ValidationFrames(*frames, context.image_sizes, config.run.batch_size,
                   config.data.pose.roll_offsets_deg);
  return frames;
}

void RequireHeldOut(const RealConfig& real, const BatchSlice& slice) {
  if (!real.validation.empty() && slice.count != 0)
    throw ConfigError("data.real.validation: frames are scored by one process alone");
  for (const std::string& held : real.validation) {
    for (const std::string& seen : real.calibrations) {
      if (!std::filesystem::equivalent(held, seen)) continue;
      throw ConfigError(fmt::format(
          "data.real.validation: {} is one of data.real.calibrations: validation would see frames "
          "of the training",
          held));
    }
  }
}

/// Identity of the samples' sources beside the configuration.
std::string IdentityOf(const Dataset* training, const RealConfig& real,
                       const std::vector<RealFrame>* frames) {
  std::string identity = training ? training->header().Identity() : "";
  for (const std::string& file : real.calibrations)
    identity += " " + Sha256(ReadFile(file, kMaxResultBytes));
  if (frames == nullptr) return identity;
  for (const RealFrame& frame : *frames) {
    const auto* bytes = reinterpret_cast<const char*>(frame.depth.data());
    identity += " " + Sha256({bytes, frame.depth.size() * sizeof(float)});
  }
  return identity;
}

}  // namespace

SampleSource RenderedSamples(std::shared_ptr<const SampleContext> context, const RunConfig& run,
                             RendererFactory renderers, std::uint64_t seed,
                             std::uint64_t first_index, const BatchSlice& slice) {
  const int count = slice.count > 0 ? slice.count : context->batch_size;
  return [count, draw = StreamSamples(std::move(context), {seed, first_index, run.loader_threads,
                                                           std::move(renderers), slice})] {
    std::vector<Sample> batch;
    for (int i = 0; i < count; ++i) batch.push_back(draw());
    return batch;
  };
}

TrainingData OpenTrainingData(const TrainConfig& config, const BatchSlice& slice) {
  config.Validate();
  const auto context =
      std::make_shared<const SampleContext>(MakeSampleContext(config.data, config.run.batch_size));
  const std::shared_ptr<const Dataset> training = OpenTrainingSet(config, *context);
  const std::shared_ptr<const Dataset> validation = OpenValidationSet(config, *context);
  RequireApart(config, training.get(), validation.get());
  const auto real = OpenRealFrames(config.data.real.calibrations, config, *context),
             held = OpenRealFrames(config.data.real.validation, config, *context);
  RequireHeldOut(config.data.real, slice);
  TrainingData data;
  data.renderer = config.data.renderer;
  RendererFactory make;
  if (!training || (!validation && !held && config.run.validation_samples > 0)) {
    Renderers renderers = RendererOf(config, training != nullptr);
    data.renderer = renderers.kind;
    data.drawn_by = std::move(renderers.description);
    make = std::move(renderers.make);
  }
  data.structure = context->structure;
  data.intrinsics = context->pool;
  data.identity = IdentityOf(training.get(), config.data.real, real.get());
  const std::vector<double> rolls = config.data.pose.roll_offsets_deg;
  data.open_training = [training, context, run = config.run, make, slice, real, rolls,
                        share = config.data.real.share](std::int64_t first) {
    auto source = OpenSource(training, context, run, make, run.seed, first, slice);
    if (!real) return source;
    return MixRecordedFrames(std::move(source), real, share, static_cast<std::uint64_t>(run.seed),
                             rolls);
  };
  if (held) {
    data.validation_frames = static_cast<int>(held->size());
    data.open_validation = [held, context, rolls, batch = config.run.batch_size] {
      return ValidationFrames(*held, context->image_sizes, batch, rolls);
    };
    return data;
  }
  data.open_validation = [validation, context, run = config.run, make, slice] {
    return OpenSource(validation, context, run, make, run.validation_seed, 0, slice);
  };
  return data;
}

}  // namespace volalign
