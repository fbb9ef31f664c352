#include "train/training_data.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "render/dataset.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "train/dataset_source.h"
#include "train/real_frames.h"

namespace volalign {
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
  HeldOut(*frames, context.image_sizes, config.run.batch_size, config.data.pose.roll_offsets_deg);
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
    data.renderer = std::move(renderers.name);
    data.drawn_by = std::move(renderers.description);
    make = std::move(renderers.make);
  }
  data.structure = context->structure;
  data.identity = IdentityOf(training.get(), config.data.real, real.get());
  const std::vector<double> rolls = config.data.pose.roll_offsets_deg;
  data.open_training = [training, context, run = config.run, make, slice, real, rolls,
                        share = config.data.real.share](std::int64_t first) {
    auto source = OpenSource(training, context, run, make, run.seed, first, slice);
    if (!real) return source;
    return MixIn(std::move(source), real, share, static_cast<std::uint64_t>(run.seed), rolls);
  };
  if (held) {
    data.validation_frames = static_cast<int>(held->size());
    data.open_validation = [held, context, rolls, batch = config.run.batch_size] {
      return HeldOut(*held, context->image_sizes, batch, rolls);
    };
    return data;
  }
  data.open_validation = [validation, context, run = config.run, make, slice] {
    return OpenSource(validation, context, run, make, run.validation_seed, 0, slice);
  };
  return data;
}

}  // namespace volalign
