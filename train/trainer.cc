#include "train/trainer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "core/error.h"
#include "core/file_util.h"
#include "train/compute.h"
#include "train/interrupt.h"
#include "train/learner.h"
#include "train/metrics.h"
#include "train/schedule.h"
#include "train/sinks.h"
#include "train/state.h"
#include "train/step.h"

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

bool Crossed(std::int64_t before, std::int64_t after, std::int64_t every) {
  return before / every != after / every;
}

/// Finds the run to continue, or makes sure that there is none. True: continue.
bool HasState(const std::filesystem::path& state, const TrainOptions& options) {
  const bool exists = std::filesystem::exists(state);
  if (options.resume && !exists) {
    throw IoError(fmt::format("{}: no such file, so there is nothing to resume: drop --resume",
                              state.string()));
  }
  if (!options.resume && exists) {
    throw Error(fmt::format("{} holds a run already: use --resume, or another --run-dir",
                            options.run_dir.string()));
  }
  return exists;
}

/// A run at work: its parts, and what joins them.
class Run {
 public:
  Run(const TrainingData& data, const TrainConfig& config, const TrainOptions& options)
      : data_(data),
        config_(config),
        state_path_(options.run_dir / "last.state"),
        model_path_(options.run_dir / "model.pt"),
        compute_(ChooseCompute(config.run)),
        learner_(config, data.structure.num_classes(), compute_),
        loss_(config.loss, data.structure, compute_.device) {
    if (HasState(state_path_, options)) {
      progress_ = LoadState(state_path_, config, data.identity, &learner_);
    } else if (!config.run.init.empty()) {
      progress_.init_samples = StartFrom(config.run.init, data.structure, &learner_);
    }
    WriteFileAtomically(options.run_dir / "config.yaml", WriteConfig(config));
    jsonl_.emplace(options.run_dir / "metrics.jsonl", progress_.samples);
    sinks_ = {&*jsonl_};
    if (!options.quiet) sinks_.push_back(&bar_.emplace(config.run.samples));
  }

  TrainResult Train(std::int64_t stop) {
    const InterruptGuard guard;
    TrainResult result;
    result.checkpoint = model_path_;
    std::unique_ptr<SampleSource> source;
    if (progress_.samples < stop) source = data_.open_training(progress_.samples);
    std::int64_t saved = progress_.samples, validated = -1;
    while (progress_.samples < stop && !guard.Interrupted()) {
      const std::int64_t before = progress_.samples;
      result.loss = Step(*source);
      const auto crossed = [&](std::int64_t every) {
        return Crossed(before, progress_.samples, every);
      };
      if (crossed(config_.run.log_every) || progress_.samples >= stop) WriteTrainRow();
      if (crossed(config_.run.validate_every)) {
        result.validation = ValidateNow();
        validated = progress_.samples;
      }
      if (crossed(config_.run.checkpoint_every)) {
        Save();
        saved = progress_.samples;
      }
    }
    result.samples = progress_.samples;
    result.finished = progress_.samples >= config_.run.samples;
    if (result.finished && validated != progress_.samples) result.validation = ValidateNow();
    if (saved != progress_.samples || !std::filesystem::exists(model_path_)) Save();
    if (bar_) {
      bar_->Line(fmt::format("{} after {} samples: {}",
                             result.finished ? "finished" : "stopped (continue with --resume)",
                             progress_.samples, model_path_.string()));
    }
    return result;
  }

 private:
  /// The loss.
  double Step(SampleSource& source) {
    const auto start = Clock::now();
    const std::vector<Sample> drawn = source.Next();
    const Batch batch = Collate(drawn).To(compute_.device);
    progress_.NoteCameras(drawn);
    StepReport report;
    report.times.data = Seconds(start);
    const at::Tensor norm =
        ComputeGradient(learner_, loss_, batch, compute_, progress_.samples, &report);
    RequireFinite(report, static_cast<std::int64_t>(drawn.size()));
    const auto updating = Clock::now();
    progress_.lr = LearningRate(config_.optim, progress_.samples, config_.run.samples);
    learner_.Update(progress_.lr, norm);
    Synchronize(compute_.device);
    report.times.optim = Seconds(updating);
    progress_.samples += static_cast<std::int64_t>(drawn.size());
    means_.Add(report, static_cast<std::int64_t>(drawn.size()));
    return report.loss;
  }

  static double Seconds(Clock::time_point since) {
    return std::chrono::duration<double>(Clock::now() - since).count();
  }

  /// Before the weights change, so that no bad step ever reaches them.
  void RequireFinite(const StepReport& report, std::int64_t samples) const {
    if (std::isfinite(report.loss) && std::isfinite(report.gradient_norm)) return;
    throw Error(fmt::format(
        "step {} (samples {} to {}): loss {} with gradient norm {}: lower optim.lr or set "
        "optim.clip_norm; the last good state is {}",
        learner_.optimizer.steps() + 1, progress_.samples, progress_.samples + samples - 1,
        report.loss, report.gradient_norm,
        std::filesystem::exists(state_path_) ? state_path_.string() : "none"));
  }

  void WriteTrainRow() {
    const TrainRow row = means_.Take(learner_.optimizer.steps(), progress_.samples, progress_.lr);
    for (MetricSink* sink : sinks_) sink->Train(row);
  }

  ValidationResult ValidateNow() {
    if (config_.run.validation_samples == 0) return {};
    learner_.average.Refresh(learner_.flat);
    const std::unique_ptr<SampleSource> source = data_.open_validation();
    ValidationResult result = Validate(
        learner_.average.net(), loss_, data_.structure, ParseKeypointKind(config_.loss.keypoints),
        *source, config_.run.validation_samples, compute_.device, compute_.channels_last);
    for (MetricSink* sink : sinks_) {
      sink->Validation({learner_.optimizer.steps(), progress_.samples, result});
    }
    return result;
  }

  void Save() {
    SaveState(state_path_, config_, data_.identity, learner_, progress_);
    SaveModel(model_path_, config_, data_.structure, learner_, progress_);
  }

  const TrainingData& data_;
  const TrainConfig& config_;
  std::filesystem::path state_path_, model_path_;
  Compute compute_;
  Learner learner_;
  TrainingLoss loss_;
  RunProgress progress_;
  StepMeans means_;
  std::optional<JsonlSink> jsonl_;
  std::optional<ProgressSink> bar_;
  std::vector<MetricSink*> sinks_;
};

}  // namespace

TrainResult Train(const TrainConfig& config, const TrainOptions& options) {
  return TrainOn(OpenTrainingData(config), config, options);
}

TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options) {
  ValidateConfig(config);
  config.Validate();
  Run run(data, config, options);
  const std::int64_t samples = config.run.samples;
  return run.Train(options.stop_at_samples > 0 ? std::min(options.stop_at_samples, samples)
                                               : samples);
}

}  // namespace volalign
