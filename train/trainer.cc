#include "train/trainer.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/where.h>
#include <ATen/ops/zeros.h>
#include <c10/util/Exception.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "train/batch.h"
#include "train/compute.h"
#include "train/data_parallel.h"
#include "train/distributed/process_group.h"
#include "train/log/run_folder.h"
#include "train/log/sinks.h"
#include "train/losses.h"
#include "train/run_inputs.h"
#include "train/saved_state.h"
#include "train/step.h"
#include "train/train_state.h"

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kStatesKept = 2;
/// Batches that are packed for a CUDA device while an earlier one is in training.
constexpr int kAhead = 2;

double Seconds(Clock::time_point since) {
  return std::chrono::duration<double>(Clock::now() - since).count();
}

bool Crossed(std::int64_t before, std::int64_t after, std::int64_t every) {
  return before / every != after / every;
}

/// Leaves a step or a validation, which is done again when the run continues.
struct Interruption {};

/// A running training with its parts. Only rank 0 of several processes has a folder; the others
/// have nullptr. All references have to outlive the run. Functions that return bool return false if
/// a process was interrupted.
class Run {
 public:
  /// Continues `saved`, or starts at the first sample, up to options.stop_at_samples.
  Run(const TrainingData& data, const TrainConfig& config, const Compute& compute,
      ProcessGroup& group, const RunFolder* folder, std::optional<SavedState> saved,
      const TrainOptions& options, const InterruptGuard& guard)
      : data_(data),
        config_(config),
        group_(group),
        folder_(folder),
        guard_(guard),
        compute_(compute),
        stop_(options.stop_at_samples > 0 ? std::min(options.stop_at_samples, config.run.samples)
                                          : config.run.samples),
        state_(config, data.structure.num_classes(), compute_),
        loss_(config.loss, data.structure, compute_.device) {
    saved_ = std::stoll(group.BroadcastFromRankZero([&] {
      InitialiseOnRankZero(std::move(saved), options);
      return std::to_string(saved_);
    }));
    BroadcastState(group, &state_, &progress_);
  }

  /// Writes to stderr, in rank 0 of a run that is not quiet.
  void Say(const std::string& sentence) {
    if (bar_) bar_->Line(sentence);
  }

  TrainResult Train() {
    try {
      // A run may have been interrupted in a validation, or its length changed to the present
      // sample.
      const bool owed = IsValidationDue(), validated = ValidateIfOwed();
      if (owed && validated) saved_ = -1;
      ended_ = Clock::now();
      if (validated && progress_.samples < stop_) {
        const auto next = FeedBatches(data_.open_training(progress_.samples), compute_.device,
                                      compute_.device.is_cpu() ? 0 : kAhead);
        // Drawing a batch may take long, so interruptions are looked for before.
        while (progress_.samples < stop_ &&
               SaveStateOnLostProcess([&] { return !Interrupted(); }) && TrainStep(next())) {
        }
      }
      return End();
    } catch (const c10::OutOfMemoryError&) {
      const int micro = config_.run.micro_batch;
      throw Error(fmt::format(
          "step {}: {} is out of memory with {} samples at once: set run.micro_batch to fewer, "
          "which gives the same step, or run.batch_size; the last state, for --resume, is {}",
          state_.optimizer.steps() + 1, compute_.device.str(),
          micro > 0 ? micro : config_.run.batch_size, LastState()));
    }
  }

 private:
  /// A step with the validation and saving that are due after it.
  bool TrainStep(const Batch& batch) {
    const std::int64_t before = progress_.samples;
    if (!SaveStateOnLostProcess([&] { return Step(batch); })) return false;
    const RunConfig& run = config_.run;
    const bool last = progress_.samples >= run.samples;
    const auto due = [&](std::int64_t every) {
      return last || Crossed(before, progress_.samples, every);
    };
    if (due(run.log_every)) WriteTrainRow();
    if (!ValidateIfOwed()) return false;
    // After the rows of these samples, so that a continued run has them all.
    if (due(run.checkpoint_every)) Save();
    ended_ = Clock::now();
    return true;
  }

  TrainResult End() {
    FlushStepMeans();
    TrainResult& result = result_;
    if (folder_ != nullptr) result.checkpoint = folder_->model();
    result.samples = progress_.samples;
    result.signal = signal_;
    result.finished = progress_.samples >= config_.run.samples && signal_ == 0;
    if (saved_ != progress_.samples) {
      Save();
    } else if (modelled_ != progress_.samples && folder_ != nullptr) {
      SaveModel(folder_->model(), config_, data_, state_, progress_);
    }
    Say(fmt::format("{} after {} samples: {}",
                    result.finished ? "finished" : "stopped (continue with --resume)",
                    progress_.samples, result.checkpoint.string()));
    return result;
  }

  /// Restores the state in rank 0 and opens the files of the folder.
  void InitialiseOnRankZero(std::optional<SavedState> saved, const TrainOptions& options) {
    if (saved) {
      Restore(*saved, &state_);
      progress_ = saved->progress;
      saved_ = progress_.samples;
    } else if (!config_.run.init.empty()) {
      progress_.init_samples = StartFrom(config_.run.init, data_.structure, &state_);
    }
    folder_->BeginAfter(progress_.samples);
    if (options.begun) options.begun();
    WriteFileAtomically(folder_->config(), WriteConfig(config_));
    KeepInputs(folder_->dir(), config_, data_.structure);
    sinks_ = {&jsonl_.emplace(folder_->metrics(), progress_.samples)};
    if (config_.run.tensorboard) {
      sinks_.push_back(
          &board_.emplace(folder_->tensorboard(), WriteConfig(config_), progress_.samples));
    }
    if (!options.quiet) sinks_.push_back(&bar_.emplace(config_.run.samples));
  }

  /// Calls f. If another process is lost in it, saves the state before it and throws again.
  template <class F>
  bool SaveStateOnLostProcess(const F& f) {
    if (group_.size() == 1) return f();
    const at::Tensor buffers = state_.flat.buffers().clone();
    try {
      return f();
    } catch (const LostProcess& e) {
      state_.flat.buffers().copy_(buffers);
      if (folder_ != nullptr && saved_ != progress_.samples) SaveAlone();
      throw LostProcess(fmt::format(
          "after {} samples: {}: --resume continues the run, with any number of processes",
          progress_.samples, e.what()));
    }
  }

  /// Was any of the processes interrupted?
  bool Interrupted() {
    signal_ = guard_.Signal();
    if (group_.size() == 1) return signal_ != 0;
    constexpr std::array<int, 2> kSignals = {SIGINT, SIGTERM};
    at::Tensor came = at::zeros({kSignals.size()}, at::kInt);
    for (std::size_t i = 0; i < kSignals.size(); ++i) {
      if (signal_ == kSignals[i]) came.data_ptr<int>()[i] = 1;
    }
    group_.Sum(came);
    for (std::size_t i = 0; i < kSignals.size(); ++i) {
      if (came.data_ptr<int>()[i] > 0) signal_ = kSignals[i];
    }
    return signal_ != 0;
  }

  bool IsValidationDue() const {
    return progress_.validated != progress_.samples &&
           (progress_.samples >= config_.run.samples ||
            Crossed(progress_.validated, progress_.samples, config_.run.validate_every));
  }

  bool Step(const Batch& batch) {
    // Processes have different numbers of micro-batches, so they cannot agree between these.
    const bool alone = group_.size() == 1;
    const std::int64_t samples = alone ? batch.depth.size(0) : config_.run.batch_size;
    const double share = static_cast<double>(batch.depth.size(0)) / static_cast<double>(samples);
    StepTimes times;
    times.data = Seconds(ended_);
    // Avoids waiting for a device, except in one step of each row.
    const bool measured = compute_.device.is_cpu() || !pending_.sums.defined();
    const auto start = Clock::now();
    const at::Tensor buffers = state_.flat.buffers().clone();
    StepNumbers numbers;
    try {
      numbers = ComputeGradient(state_, loss_, batch, compute_, progress_.samples,
                                config_.run.micro_batch, measured ? &times : nullptr, share,
                                alone ? nullptr : &group_, [&] {
                                  if (alone && Interrupted()) throw Interruption();
                                });
    } catch (const Interruption&) {
      state_.flat.buffers().copy_(buffers);
      return false;
    }
    progress_.NoteCameras(batch.cameras);
    const auto updating = Clock::now();
    progress_.lr = LearningRate(config_.optim, progress_.samples, config_.run.samples);
    at::Tensor& moved = state_.flat.buffers();
    moved.copy_(at::where(numbers.finite, moved, buffers));
    state_.Update(progress_.lr, numbers.norm, numbers.finite);
    if (measured) {
      Synchronize(compute_.device);
      pending_.measured = times;
      pending_.measured.optim = Seconds(updating);
    }
    // All time but that of data counts as the optimiser's until FlushStepMeans shares it out.
    pending_.times.data += times.data;
    pending_.times.optim += Seconds(start);
    const at::Tensor sums = numbers.Sums();
    pending_.sums = pending_.sums.defined() ? pending_.sums + sums : sums;
    pending_.samples += samples;
    progress_.samples += samples;
    if (compute_.device.is_cpu()) FlushStepMeans();
    return true;
  }

  /// Adds all steps to progress_.means. Waits for the device.
  void FlushStepMeans() {
    if (!pending_.sums.defined()) return;
    StepReport report = ReadSums(pending_.sums, loss_.names());
    report.times = ShareOut(pending_.times, pending_.measured);
    progress_.means.Add(report, pending_.samples);
    pending_ = {};
  }

  void WriteTrainRow() {
    FlushStepMeans();
    const StepReport& sum = progress_.means.sum;
    if (sum.skipped == sum.steps) {
      throw Error(fmt::format(
          "step {} (samples up to {}): loss or gradient is not finite, as in all {} steps since "
          "the "
          "last row of the log: lower optim.lr or set optim.clip_norm; the last good state is {}",
          state_.optimizer.steps() + 1, progress_.samples - 1, sum.steps, LastState()));
    }
    const TrainRow row =
        progress_.means.Take(state_.optimizer.steps(), progress_.samples, progress_.lr);
    for (MetricSink* sink : sinks_) sink->Train(row);
  }

  /// The last state, for a message.
  std::string LastState() const {
    return folder_ != nullptr && saved_ >= 0 ? folder_->State(saved_).string() : "none";
  }

  bool ValidateIfOwed() {
    if (!IsValidationDue()) return true;
    FlushStepMeans();
    ValidationResult result;
    const int samples =
        data_.validation_frames > 0 ? data_.validation_frames : config_.run.validation_samples;
    if (samples > 0) {
      state_.average.Refresh(state_.flat);
      const CountDone count = bar_ ? bar_->Counter() : nullptr;
      try {
        result = Validate(state_.average.net(), loss_, data_.structure, config_.loss.keypoints,
                          data_.open_validation(), OwnShare(samples), compute_.device,
                          compute_.channels_last, [&](std::int64_t done, std::int64_t all) {
                            if (count) count(done, all);
                            if (Interrupted()) throw Interruption();
                          });
      } catch (const Interruption&) {
        return false;
      }
      result = MergeValidation(group_, result, config_.run.batch_size);
    }
    progress_.validated = progress_.samples;
    result_.validation = result;
    if (samples == 0) return true;
    for (MetricSink* sink : sinks_)
      sink->Validation({state_.optimizer.steps(), progress_.samples, result});
    if (progress_.best.Note(result, progress_.samples)) {
      ReduceSeenIntrinsics(group_, &progress_);
      if (folder_ != nullptr) SaveModel(folder_->best(), config_, data_, state_, progress_);
    }
    return true;
  }

  /// Of so many validation samples, those of this process.
  int OwnShare(int samples) const {
    if (group_.size() == 1) return samples;
    const int batch = config_.run.batch_size;
    return (samples + batch - 1) / batch * SliceOf(batch, group_.rank(), group_.size()).count;
  }

  void Save() {
    ReduceSeenIntrinsics(group_, &progress_);
    if (folder_ != nullptr) SaveAlone();
    saved_ = modelled_ = progress_.samples;
  }

  void SaveAlone() {
    FlushStepMeans();
    SaveState(folder_->State(progress_.samples), config_, data_.identity, compute_, state_,
              progress_);
    folder_->KeepStates(kStatesKept);
    SaveModel(folder_->model(), config_, data_, state_, progress_);
  }

  const TrainingData& data_;
  const TrainConfig& config_;
  ProcessGroup& group_;
  const RunFolder* folder_;
  const InterruptGuard& guard_;
  Compute compute_;
  std::int64_t stop_;
  TrainState state_;
  TrainingLoss loss_;
  RunProgress progress_;
  TrainResult result_;
  /// Numbers of the steps since the last row that are only on the device and not in
  /// progress_.means. On a CPU it is empty between steps.
  struct {
    at::Tensor sums;  ///< StepNumbers::Sums
    StepTimes times, measured;
    std::int64_t samples = 0;
  } pending_;
  Clock::time_point ended_;     ///< end of the last step, with validation and saving
  int signal_ = 0;              ///< the signal that interrupted the run
  std::int64_t saved_ = -1;     ///< samples of the newest state
  std::int64_t modelled_ = -1;  ///< samples of the model.safetensors that this process wrote
  std::optional<JsonlSink> jsonl_;
  std::optional<TensorBoardSink> board_;
  std::optional<ProgressSink> bar_;
  std::vector<MetricSink*> sinks_;
};

[[noreturn]] void NothingToResume(const std::filesystem::path& dir) {
  throw IoError(fmt::format("{}: there is no run to resume here: drop --resume", dir.string()));
}

/// The state to continue, or nothing for a run that starts at its first sample.
std::optional<SavedState> ReadState(const RunFolder& folder, const TrainingData& data,
                                    const TrainConfig& config, bool resume,
                                    std::vector<std::string>* damaged) {
  if (!resume) {
    if (folder.States().empty()) return std::nullopt;
    throw Error(fmt::format("{} holds a run already: use --resume, or another folder",
                            folder.dir().string()));
  }
  RequireSameInputs(folder.dir(), config, data.structure);
  std::optional<SavedState> state = FindState(folder, config, data.identity, damaged);
  if (state) return state;
  // A run that was killed before its first state left only its configuration.
  if (!std::filesystem::exists(folder.config())) NothingToResume(folder.dir());
  RequireSameRun(ReadFile(folder.config(), kMaxTextBytes), config, folder.config().string());
  return std::nullopt;
}

}  // namespace

TrainResult Train(const TrainConfig& config, const TrainOptions& options) {
  const World& world = options.world;
  const BatchSlice slice =
      world.size > 1 ? SliceOf(config.run.batch_size, world.rank, world.size) : BatchSlice();
  const TrainingData data = OpenTrainingData(config, slice);
  TrainConfig drawn = config;
  drawn.data.renderer = data.renderer;
  return TrainOn(data, drawn, options);
}

TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options) {
  const InterruptGuard guard;
  ValidateConfig(config);
  config.Validate();
  Compute compute = ChooseCompute(config.run, options.world);
  ProcessGroup group;
  if (options.world.size > 1) {
    RequireProcesses(config, options.world.size);
    group.Connect(options.world, compute.device, config.run.lost_after_s);
  }
  std::optional<RunFolder> folder;
  std::optional<SavedState> state;
  std::vector<std::string> damaged;
  compute =
      AgreeOnCompute(group, {compute, WriteConfig(config), data.identity + data.structure.Hash()},
                     [&](Compute chosen) {
                       if (options.resume && !std::filesystem::exists(options.run_dir)) {
                         NothingToResume(options.run_dir);
                       }
                       folder.emplace(options.run_dir);
                       state = ReadState(*folder, data, config, options.resume, &damaged);
                       if (!state) return chosen;
                       chosen.type = state->bf16 ? at::kBFloat16 : at::kFloat;
                       chosen.channels_last = state->channels_last;
                       return chosen;
                     });
  Run run(data, config, compute, group, folder ? &*folder : nullptr, std::move(state), options,
          guard);
  run.Say(ToString(compute));
  if (!data.drawn_by.empty()) run.Say("renderer: " + data.drawn_by);
  if (group.size() > 1) run.Say(fmt::format("{} processes", group.size()));
  for (const std::string& sentence : damaged) run.Say("warning: " + sentence);
  const OptimConfig& optim = config.optim;
  if (optim.DependsOnLength() && optim.warmup_samples >= config.run.samples)
    run.Say(
        fmt::format("optim.warmup_samples = {} is not shorter than run.samples = {}: the "
                    "learning rate does not reach optim.lr",
                    optim.warmup_samples, config.run.samples));
  return run.Train();
}

}  // namespace volalign
