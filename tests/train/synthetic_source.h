#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/lens.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "core/nn/cpu/torch_threads.h"
#include "tests/core/base/read_file.h"
#include "train/batch.h"
#include "train/trainer.h"
#include "train/training_data.h"

namespace volalign {

/// The samples' values on the CPU. Throws as BatchPacker.
inline Batch Collate(const std::vector<Sample>& samples) {
  return Unpack(BatchPacker(at::kCPU).Pack(samples));
}

/// The bare structure, ray-cast without noise: sample i is a function of (seed, i modulo `period`).
class SyntheticSource {
 public:
  SyntheticSource(Structure structure, std::uint64_t seed, std::uint64_t first_index,
                  int batch_size, int size, std::uint64_t period, const BatchSlice& slice)
      : structure_(std::move(structure)),
        seed_(seed),
        next_(first_index),
        batch_size_(batch_size),
        size_(size),
        period_(period),
        slice_(slice) {
    if (slice_.count == 0) slice_.count = batch_size;
  }

  std::vector<Sample> operator()() {
    std::vector<Sample> batch;
    batch.reserve(static_cast<std::size_t>(slice_.count));
    for (int i = 0; i < slice_.count; ++i)
      batch.push_back(Draw(next_ + static_cast<std::uint64_t>(slice_.first + i)));
    next_ += static_cast<std::uint64_t>(batch_size_);
    return batch;
  }

 private:
  Sample Draw(std::uint64_t index) const {
    RandomStream random(seed_, index % period_, "synthetic");
    Sample s;
    s.index = index;
    s.intrinsics.width = s.intrinsics.height = size_;
    s.intrinsics.fx = s.intrinsics.fy = 0.8 * size_;
    s.intrinsics.cx = s.intrinsics.cy = 0.5 * size_;
    const double phi = random.Uniform(0, 2 * M_PI), rho = random.Uniform(1.5, 2.25);
    s.structure_from_sensor =
        LookAt({rho * std::cos(phi), random.Uniform(-0.15, 0.75), rho * std::sin(phi)},
               {random.Uniform(-0.1, 0.1), 0, random.Uniform(-0.1, 0.1)}, M_PI / 2);
    const ExpectedView view =
        CastView(structure_, ComputeRays(s.intrinsics), s.structure_from_sensor);
    s.depth = view.depth;
    s.labels = view.labels;
    return s;
  }

  Structure structure_;
  std::uint64_t seed_, next_;
  int batch_size_, size_;
  std::uint64_t period_;
  BatchSlice slice_;
};

/// A source of the run's own seed, 1, and one of the validation's.
inline TrainingData SyntheticData(int batch_size, int size, std::uint64_t period,
                                  const BatchSlice& slice = {}) {
  TrainingData data;
  data.structure = ReadStructure("configs/structure.yaml");
  const auto open = [structure = data.structure, batch_size, size, period, slice](
                        std::uint64_t seed, std::int64_t first) {
    return SyntheticSource(structure, seed, static_cast<std::uint64_t>(first), batch_size, size,
                           period, slice);
  };
  data.open_training = [=](std::int64_t first_sample) { return open(1, first_sample); };
  data.open_validation = [=] { return open(1000001, 0); };
  return data;
}

/// Of keys in YAML.
inline TrainConfig ConfigOf(const std::string& yaml) {
  return ReadConfig<TrainConfig>(ConfigSource::FromString(yaml, "test"));
}

/// configs/m05-lite.yaml with a small network on one thread and two samples of 40 x 36 or 64 x 36
/// pixels a batch. `changes`: KEY=VALUE.
inline TrainConfig SmallRecipe(const std::vector<std::string>& changes = {}) {
  SetTorchThreads(1);
  ConfigSource source = ConfigSource::FromFile("configs/m05-lite.yaml");
  for (const char* assignment :
       {"model.base_channels=2", "model.residual_blocks=1", "data.image_sizes=[40x36, 64x36]",
        "run.batch_size=2", "run.samples=24", "run.log_every=2", "run.validation_samples=4",
        "optim.warmup_samples=4", "loss.min_side_pixels=3"})
    source.Set(assignment);
  for (const std::string& assignment : changes) source.Set(assignment);
  return ReadTrainConfig(source);
}

inline TrainOptions QuietRun(const std::filesystem::path& run_dir, std::int64_t stop_at_samples = 0,
                             bool resume = false) {
  TrainOptions options;
  options.run_dir = run_dir;
  options.quiet = true;
  options.stop_at_samples = stop_at_samples;
  options.resume = resume;
  return options;
}

/// The source that `open` makes, of which `change` gets each batch and its number, from 1.
template <class... Arguments>
auto WatchedSource(std::function<SampleSource(Arguments...)> open,
                   std::function<void(std::vector<Sample>* batch, int number)> change) {
  return [open = std::move(open), change = std::move(change)](Arguments... arguments) {
    return [inner = open(arguments...), change, calls = 0]() mutable {
      std::vector<Sample> batch = inner();
      change(&batch, ++calls);
      return batch;
    };
  };
}

/// Rows of metrics.jsonl: those of a type, or all without what depends on the clock.
inline std::vector<nlohmann::json> MetricsRows(const std::filesystem::path& run_dir,
                                               const std::string& type = "") {
  std::vector<nlohmann::json> rows;
  std::istringstream text(ReadFile(run_dir / "metrics.jsonl"));
  for (std::string line; std::getline(text, line);) {
    nlohmann::json row = nlohmann::json::parse(line);
    if (!type.empty() && row.at("type") != type) continue;
    if (type.empty()) {
      row.erase("step_s");
      row.erase("samples_per_s");
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace volalign
