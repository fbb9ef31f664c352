#include "train/run.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/where.h>
#include <ATen/ops/zeros.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <memory>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "train/log/metrics.h"
#include "train/optimizer.h"
#include "train/run_inputs.h"
#include "train/together.h"

namespace volalign {
namespace {

constexpr int kStatesKept = 2;

double Seconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

bool Crossed(std::int64_t before, std::int64_t after, std::int64_t every) {
  return before / every != after / every;
}

/// Leaves a step or a validation, which is done again when the run continues.
struct Interruption {};

}  // namespace

Run::Run(const TrainingData& data, const TrainConfig& config, const Compute& compute,
         ProcessGroup& group, const RunFolder* folder, std::optional<SavedState> state,
         const TrainOptions& options, const InterruptGuard& guard)
    : data_(data),
      config_(config),
      group_(group),
      folder_(folder),
      guard_(guard),
      compute_(compute),
      stop_(options.stop_at_samples > 0 ? std::min(options.stop_at_samples, config.run.samples)
                                        : config.run.samples),
      learner_(config, data.structure.num_classes(), compute_),
      loss_(config.loss, data.structure, compute_.device) {
  saved_ = std::stoll(group.FromLead([&] {
    Lead(std::move(state), options);
    return std::to_string(saved_);
  }));
  ShareState(group, &learner_, &progress_);
}

void Run::Say(const std::string& sentence) {
  if (bar_) bar_->Line(sentence);
}

bool Run::Begin() {
  if (folder_ != nullptr) result_.checkpoint = folder_->model();
  // A run may have been interrupted in a validation, or its length changed to the present sample.
  const bool owed = OwesValidation();
  if (!ValidateIfOwed()) return false;
  if (owed) saved_ = -1;
  ended_ = Clock::now();
  return progress_.samples < stop_;
}

bool Run::Ready() {
  return Rescued([&] { return !Interrupted(); });
}

bool Run::Advance(const Batch& batch) {
  const std::int64_t before = progress_.samples;
  if (!Rescued([&] { return Step(batch); })) return false;
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
  return progress_.samples < stop_;
}

std::string Run::OutOfMemory() const {
  const int micro = config_.run.micro_batch;
  return fmt::format(
      "step {}: {} is out of memory with {} samples at once: set run.micro_batch to fewer, which "
      "gives the same step, or run.batch_size; the last state, for --resume, is {}",
      learner_.optimizer.steps() + 1, compute_.device.str(),
      micro > 0 ? micro : config_.run.batch_size, LastState());
}

TrainResult Run::End() {
  Collect();
  TrainResult& result = result_;
  result.samples = progress_.samples;
  result.signal = signal_;
  result.finished = progress_.samples >= config_.run.samples && signal_ == 0;
  if (saved_ != progress_.samples) {
    Save();
  } else if (modelled_ != progress_.samples && folder_ != nullptr) {
    SaveModel(folder_->model(), config_, data_, learner_, progress_);
  }
  Say(fmt::format("{} after {} samples: {}",
                  result.finished ? "finished" : "stopped (continue with --resume)",
                  progress_.samples, result.checkpoint.string()));
  return result;
}

/// False if it was interrupted.
bool Run::ValidateIfOwed() {
  if (!OwesValidation()) return true;
  std::optional<ValidationResult> validation = ValidateNow();
  if (!validation) return false;
  result_.validation = std::move(*validation);
  return true;
}

/// Restores the state in rank 0 and opens the files of the folder.
void Run::Lead(std::optional<SavedState> state, const TrainOptions& options) {
  if (state) {
    Restore(*state, &learner_);
    progress_ = state->progress;
    saved_ = progress_.samples;
  } else if (!config_.run.init.empty()) {
    progress_.init_samples = StartFrom(config_.run.init, data_.structure, &learner_);
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
bool Run::Rescued(const F& f) {
  if (group_.size() == 1) return f();
  const at::Tensor buffers = learner_.flat.buffers().clone();
  try {
    return f();
  } catch (const LostProcess& e) {
    learner_.flat.buffers().copy_(buffers);
    if (folder_ != nullptr && saved_ != progress_.samples) SaveAlone();
    throw LostProcess(fmt::format(
        "after {} samples: {}: --resume continues the run, with any number of processes",
        progress_.samples, e.what()));
  }
}

/// Was any of the processes interrupted?
bool Run::Interrupted() {
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

bool Run::OwesValidation() const {
  return progress_.validated != progress_.samples &&
         (progress_.samples >= config_.run.samples ||
          Crossed(progress_.validated, progress_.samples, config_.run.validate_every));
}

/// False if a process was interrupted.
bool Run::Step(const Batch& batch) {
  // Processes have different numbers of micro-batches, so they cannot agree between these.
  const bool alone = group_.size() == 1;
  const std::int64_t samples = alone ? batch.depth.size(0) : config_.run.batch_size;
  const double share = static_cast<double>(batch.depth.size(0)) / static_cast<double>(samples);
  StepTimes times;
  times.data = Seconds(ended_);
  // Avoids waiting for a device, except in one step of each row.
  const bool measured = compute_.device.is_cpu() || !pending_.sums.defined();
  const auto start = Clock::now();
  const at::Tensor buffers = learner_.flat.buffers().clone();
  StepNumbers numbers;
  try {
    numbers = ComputeGradient(learner_, loss_, batch, compute_, progress_.samples,
                              config_.run.micro_batch, measured ? &times : nullptr, share,
                              alone ? nullptr : &group_, [&] {
                                if (alone && Interrupted()) throw Interruption();
                              });
  } catch (const Interruption&) {
    learner_.flat.buffers().copy_(buffers);
    return false;
  }
  progress_.NoteCameras(batch.cameras);
  const auto updating = Clock::now();
  progress_.lr = LearningRate(config_.optim, progress_.samples, config_.run.samples);
  at::Tensor& moved = learner_.flat.buffers();
  moved.copy_(at::where(numbers.finite, moved, buffers));
  learner_.Update(progress_.lr, numbers.norm, numbers.finite);
  if (measured) {
    Synchronize(compute_.device);
    pending_.measured = times;
    pending_.measured.optim = Seconds(updating);
  }
  times = StepTimes{times.data};
  times.optim = Seconds(start);
  progress_.samples += samples;
  Note(numbers, times, samples);
  return true;
}

/// `times`: the time of data, and all other time in optim.
void Run::Note(const StepNumbers& numbers, const StepTimes& times, std::int64_t samples) {
  const at::Tensor sums = numbers.Sums();
  pending_.sums = pending_.sums.defined() ? pending_.sums + sums : sums;
  pending_.times.data += times.data;
  pending_.times.optim += times.optim;
  pending_.samples += samples;
  if (compute_.device.is_cpu()) Collect();
  timed_samples_ += samples;
  timed_s_ += Total(times);
  Foretell();
}

/// Adds all steps to progress_.means. Waits for the device.
void Run::Collect() {
  if (!pending_.sums.defined()) return;
  StepReport report = ReadSums(pending_.sums, loss_.names());
  report.times = ShareOut(pending_.times, pending_.measured);
  progress_.means.Add(report, pending_.samples);
  pending_ = {};
}

/// Writes the expected duration of the run, once, when enough steps have been timed.
void Run::Foretell() {
  constexpr std::int64_t kTimed = 100;  // samples: some steps, of which the first is slower
  constexpr double kDay = 24 * 3600;    // configs/paper/lite.yaml needs less on a CPU
  if (foretold_ || timed_samples_ < kTimed) return;
  foretold_ = true;
  const double left = static_cast<double>(config_.run.samples - progress_.samples) * timed_s_ /
                      static_cast<double>(timed_samples_);
  if (left <= 0) return;
  const bool too_long = compute_.device.is_cpu() && left > kDay;
  Say(fmt::format("about {} at this speed{}", RoundDuration(left),
                  too_long ? "; configs/paper/lite.yaml suits a CPU" : ""));
}

void Run::WriteTrainRow() {
  Collect();
  const StepReport& sum = progress_.means.sum;
  if (sum.skipped == sum.steps) {
    throw Error(fmt::format(
        "step {} (samples up to {}): loss or gradient is not finite, as in all {} steps since the "
        "last row of the log: lower optim.lr or set optim.clip_norm; the last good state is {}",
        learner_.optimizer.steps() + 1, progress_.samples - 1, sum.steps, LastState()));
  }
  const TrainRow row =
      progress_.means.Take(learner_.optimizer.steps(), progress_.samples, progress_.lr);
  for (MetricSink* sink : sinks_) sink->Train(row);
}

/// The last state, for a message.
std::string Run::LastState() const {
  return folder_ != nullptr && saved_ >= 0 ? folder_->State(saved_).string() : "none";
}

/// Nothing if a process was interrupted.
std::optional<ValidationResult> Run::ValidateNow() {
  Collect();
  if (config_.run.validation_samples == 0 && data_.validation_frames == 0) {
    progress_.validated = progress_.samples;
    return ValidationResult();
  }
  learner_.average.Refresh(learner_.flat);
  const CountDone count = bar_ ? bar_->Counter() : nullptr;
  const auto before_batch = [&](std::int64_t done, std::int64_t all) {
    if (count) count(done, all);
    if (Interrupted()) throw Interruption();
  };
  ValidationResult own;
  try {
    own = Validate(learner_.average.net(), loss_, data_.structure, config_.loss.keypoints,
                   data_.open_validation(), OwnValidationSamples(), compute_.device,
                   compute_.channels_last, before_batch);
  } catch (const Interruption&) {
    return std::nullopt;
  }
  progress_.validated = progress_.samples;
  ValidationResult result = ShareValidation(group_, own, config_.run.batch_size);
  for (MetricSink* sink : sinks_) {
    sink->Validation({learner_.optimizer.steps(), progress_.samples, result});
  }
  if (progress_.best.Note(result, progress_.samples)) {
    ShareCameras(group_, &progress_);
    if (folder_ != nullptr) {
      SaveModel(folder_->best(), config_, data_, learner_, progress_);
    }
  }
  return result;
}

int Run::OwnValidationSamples() const {
  const int all =
      data_.validation_frames > 0 ? data_.validation_frames : config_.run.validation_samples;
  if (group_.size() == 1) return all;
  World world;
  world.rank = group_.rank();
  world.size = group_.size();
  const int batch = config_.run.batch_size;
  return (all + batch - 1) / batch * SliceOf(batch, world).count;
}

void Run::Save() {
  ShareCameras(group_, &progress_);
  if (folder_ != nullptr) SaveAlone();
  saved_ = modelled_ = progress_.samples;
}

void Run::SaveAlone() {
  Collect();
  SaveState(folder_->State(progress_.samples), config_, data_.identity, compute_, learner_,
            progress_);
  folder_->KeepStates(kStatesKept);
  SaveModel(folder_->model(), config_, data_, learner_, progress_);
}

}  // namespace volalign
