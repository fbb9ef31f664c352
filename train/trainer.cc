#include "train/trainer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/file_util.h"
#include "train/compute.h"
#include "train/interrupt.h"
#include "train/learner.h"
#include "train/metrics.h"
#include "train/run_folder.h"
#include "train/same_run.h"
#include "train/schedule.h"
#include "train/sinks.h"
#include "train/state.h"
#include "train/step.h"
#include "train/tensorboard_sink.h"

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

bool Crossed(std::int64_t before, std::int64_t after, std::int64_t every) {
  return before / every != after / every;
}

[[noreturn]] void NothingToResume(const std::filesystem::path& dir) {
  throw IoError(fmt::format("{}: there is no run to resume here: drop --resume", dir.string()));
}

/// The state to continue, or none for a run that starts at its first sample.
std::optional<SavedState> Begin(const RunFolder& folder, const TrainingData& data,
                                const TrainConfig& config, bool resume,
                                std::vector<std::string>* damaged) {
  if (!resume) {
    if (folder.States().empty()) return std::nullopt;
    throw Error(fmt::format("{} holds a run already: use --resume, or another --run-dir",
                            folder.dir().string()));
  }
  std::optional<SavedState> state = FindState(folder, config, data.identity, damaged);
  if (state) return state;
  // A run that was killed before its first state left its configuration alone.
  if (!std::filesystem::exists(folder.config())) NothingToResume(folder.dir());
  RequireSameRun(ReadFile(folder.config()), config, folder.config().string());
  return std::nullopt;
}

/// A run at work: its parts, and what joins them.
class Run {
 public:
  Run(const TrainingData& data, const TrainConfig& config, const Compute& compute,
      const RunFolder& folder, std::optional<SavedState> state, bool quiet)
      : data_(data),
        config_(config),
        folder_(folder),
        compute_(compute),
        learner_(config, data.structure.num_classes(), compute_),
        loss_(config.loss, data.structure, compute_.device) {
    if (state) {
      Restore(*state, &learner_);
      progress_ = state->progress;
      saved_ = progress_.samples;
    } else if (!config.run.init.empty()) {
      progress_.init_samples = StartFrom(config.run.init, data.structure, &learner_);
    }
    folder.BeginAfter(progress_.samples);
    WriteFileAtomically(folder.config(), WriteConfig(config));
    jsonl_.emplace(folder.metrics(), progress_.samples);
    sinks_ = {&*jsonl_};
    if (config.run.tensorboard) {
      sinks_.push_back(
          &board_.emplace(folder.tensorboard(), WriteConfig(config), progress_.samples));
    }
    if (!quiet) sinks_.push_back(&bar_.emplace(config.run.samples));
  }

  void Say(const std::string& sentence) {
    if (bar_) bar_->Line(sentence);
  }

  TrainResult Train(std::int64_t stop) {
    const InterruptGuard guard;
    TrainResult result;
    result.checkpoint = folder_.model();
    const RunConfig& run = config_.run;
    std::unique_ptr<SampleSource> source;
    if (progress_.samples < stop) source = data_.open_training(progress_.samples);
    while (progress_.samples < stop && !LostPatience() && !guard.Interrupted()) {
      const std::int64_t before = progress_.samples;
      result.loss = Step(*source);
      const bool last = progress_.samples >= run.samples;
      const auto due = [&](std::int64_t every) {
        return last || Crossed(before, progress_.samples, every);
      };
      if (due(run.log_every)) WriteTrainRow();
      if (due(run.validate_every)) result.validation = ValidateNow();
      if (LostPatience() && progress_.means.steps > 0) WriteTrainRow();
      // After the rows of these samples, so that a run that goes on from here has them all.
      if (due(run.checkpoint_every) || LostPatience()) Save();
    }
    result.samples = progress_.samples;
    result.early = LostPatience();
    result.finished = progress_.samples >= run.samples || result.early;
    // A run whose length was changed to what it had reached already.
    if (result.finished && progress_.validated != progress_.samples) {
      result.validation = ValidateNow();
      saved_ = -1;
    }
    if (saved_ != progress_.samples) Save();
    if (modelled_ != progress_.samples) SaveModelNow();
    Say(fmt::format("{} after {} samples: {}",
                    result.early      ? "no better validation for run.patience: ended"
                    : result.finished ? "finished"
                                      : "stopped (continue with --resume)",
                    progress_.samples, folder_.model().string()));
    return result;
  }

 private:
  bool LostPatience() const {
    return config_.run.patience > 0 && progress_.best.since >= config_.run.patience;
  }

  /// The loss.
  double Step(SampleSource& source) {
    const auto start = Clock::now();
    const std::vector<Sample> drawn = source.Next();
    const Batch batch = Collate(drawn).To(compute_.device);
    progress_.NoteCameras(drawn);
    StepReport report;
    report.times.data = Seconds(start);
    const at::Tensor norm = ComputeGradient(learner_, loss_, batch, compute_, progress_.samples,
                                            config_.run.micro_batch, &report);
    RequireFinite(report, static_cast<std::int64_t>(drawn.size()));
    const auto updating = Clock::now();
    progress_.lr = LearningRate(config_.optim, progress_.samples, config_.run.samples);
    learner_.Update(progress_.lr, norm);
    Synchronize(compute_.device);
    report.times.optim = Seconds(updating);
    progress_.samples += static_cast<std::int64_t>(drawn.size());
    progress_.means.Add(report, static_cast<std::int64_t>(drawn.size()));
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
        report.loss, report.gradient_norm, saved_ >= 0 ? folder_.State(saved_).string() : "none"));
  }

  void WriteTrainRow() {
    const TrainRow row =
        progress_.means.Take(learner_.optimizer.steps(), progress_.samples, progress_.lr);
    for (MetricSink* sink : sinks_) sink->Train(row);
  }

  ValidationResult ValidateNow() {
    progress_.validated = progress_.samples;
    if (config_.run.validation_samples == 0) return {};
    learner_.average.Refresh(learner_.flat);
    const std::unique_ptr<SampleSource> source = data_.open_validation();
    ValidationResult result = Validate(
        learner_.average.net(), loss_, data_.structure, ParseKeypointKind(config_.loss.keypoints),
        *source, config_.run.validation_samples, compute_.device, compute_.channels_last);
    for (MetricSink* sink : sinks_) {
      sink->Validation({learner_.optimizer.steps(), progress_.samples, result});
    }
    if (progress_.best.Note(config_.run.best_metric, result, progress_.samples)) {
      SaveModel(folder_.best(), config_, data_.structure, learner_, progress_);
    }
    return result;
  }

  void Save() {
    SaveState(folder_.State(progress_.samples), config_, data_.identity, compute_, learner_,
              progress_);
    folder_.KeepStates(config_.run.keep_states);
    saved_ = progress_.samples;
    SaveModelNow();
  }

  void SaveModelNow() {
    SaveModel(folder_.model(), config_, data_.structure, learner_, progress_);
    modelled_ = progress_.samples;
  }

  const TrainingData& data_;
  const TrainConfig& config_;
  const RunFolder& folder_;
  Compute compute_;
  Learner learner_;
  TrainingLoss loss_;
  RunProgress progress_;
  std::int64_t saved_ = -1;     ///< samples of the newest state
  std::int64_t modelled_ = -1;  ///< samples of the model.pt that this process wrote
  std::optional<JsonlSink> jsonl_;
  std::optional<TensorBoardSink> board_;
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
  Compute compute = ChooseCompute(config.run);
  if (options.resume && !std::filesystem::exists(options.run_dir)) NothingToResume(options.run_dir);
  const RunFolder folder(options.run_dir);
  std::vector<std::string> damaged;
  std::optional<SavedState> state = Begin(folder, data, config, options.resume, &damaged);
  if (state) {
    compute.type = state->type;
    compute.channels_last = state->channels_last;
  }
  Run run(data, config, compute, folder, std::move(state), options.quiet);
  run.Say(ToString(compute));
  for (const std::string& sentence : damaged) run.Say("warning: " + sentence);
  const std::int64_t samples = config.run.samples;
  return run.Train(options.stop_at_samples > 0 ? std::min(options.stop_at_samples, samples)
                                               : samples);
}

}  // namespace volalign
