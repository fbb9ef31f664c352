#include "train/run.h"

#include <ATen/ops/zeros.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <functional>
#include <memory>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "train/log/metrics.h"
#include "train/schedule.h"
#include "train/step.h"
#include "train/together.h"

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

double Seconds(Clock::time_point since) {
  return std::chrono::duration<double>(Clock::now() - since).count();
}

bool Crossed(std::int64_t before, std::int64_t after, std::int64_t every) {
  return before / every != after / every;
}

/// Leaves a step or a validation that is to be done again when the run goes on.
struct Interruption {};

/// Looks before each batch whether the run was interrupted, and throws an Interruption then.
class Interruptible : public SampleSource {
 public:
  Interruptible(SampleSource& source, std::function<bool()> interrupted)
      : source_(source), interrupted_(std::move(interrupted)) {}
  std::vector<Sample> Next() override {
    if (interrupted_()) throw Interruption();
    return source_.Next();
  }

 private:
  SampleSource& source_;
  std::function<bool()> interrupted_;
};

}  // namespace

Run::Run(const TrainingData& data, const TrainConfig& config, const Compute& compute,
         ProcessGroup& group, const RunFolder* folder, std::optional<SavedState> state, bool quiet)
    : data_(data),
      config_(config),
      group_(group),
      folder_(folder),
      compute_(compute),
      learner_(config, data.structure.num_classes(), compute_),
      loss_(config.loss, data.structure, compute_.device) {
  saved_ = std::stoll(group.FromLead([&] {
    Lead(std::move(state), quiet);
    return std::to_string(saved_);
  }));
  ShareState(group, &learner_, &progress_);
  if (group.size() > 1) reducer_.emplace(&learner_.flat, &group);
}

void Run::Say(const std::string& sentence) {
  if (bar_) bar_->Line(sentence);
}

TrainResult Run::Train(std::int64_t stop) {
  const InterruptGuard guard;
  TrainResult result;
  if (folder_ != nullptr) result.checkpoint = folder_->model();
  const RunConfig& run = config_.run;
  // False where it was interrupted.
  const auto validate = [&] {
    if (!OwesValidation()) return true;
    const std::optional<ValidationResult> validation = ValidateNow(guard);
    if (validation) result.validation = *validation;
    return validation.has_value();
  };
  // Of a run that was interrupted in a validation, or whose length was changed to what it had
  // reached already.
  const bool owed = OwesValidation();
  bool goes_on = validate();
  if (owed && goes_on) saved_ = -1;
  std::unique_ptr<SampleSource> source;
  if (goes_on && progress_.samples < stop) source = data_.open_training(progress_.samples);
  while (goes_on && progress_.samples < stop && !LostPatience()) {
    const std::int64_t before = progress_.samples;
    const std::optional<double> loss = StepOrRescue(*source, guard);
    if (!loss) break;
    result.loss = *loss;
    const bool last = progress_.samples >= run.samples;
    const auto due = [&](std::int64_t every) {
      return last || Crossed(before, progress_.samples, every);
    };
    if (due(run.log_every)) WriteTrainRow();
    goes_on = validate();
    if (!goes_on) break;
    if (LostPatience() && progress_.means.steps > 0) WriteTrainRow();
    // After the rows of these samples, so that a run that goes on from here has them all.
    if (due(run.checkpoint_every) || LostPatience()) Save();
  }
  result.samples = progress_.samples;
  result.early = LostPatience();
  result.signal = signal_;
  result.finished = (progress_.samples >= run.samples || result.early) && signal_ == 0;
  if (saved_ != progress_.samples) {
    Save();
  } else if (modelled_ != progress_.samples && folder_ != nullptr) {
    SaveModel(folder_->model(), config_, data_, learner_, progress_);
  }
  Say(fmt::format("{} after {} samples: {}",
                  result.early      ? "no better validation for run.patience: ended"
                  : result.finished ? "finished"
                                    : "stopped (continue with --resume)",
                  progress_.samples, result.checkpoint.string()));
  return result;
}

/// The folder, and what it has of the run so far.
void Run::Lead(std::optional<SavedState> state, bool quiet) {
  if (state) {
    Restore(*state, &learner_);
    progress_ = state->progress;
    saved_ = progress_.samples;
  } else if (!config_.run.init.empty()) {
    progress_.init_samples = StartFrom(config_.run.init, data_.structure, &learner_);
  }
  folder_->BeginAfter(progress_.samples);
  WriteFileAtomically(folder_->config(), WriteConfig(config_));
  sinks_ = {&jsonl_.emplace(folder_->metrics(), progress_.samples)};
  if (config_.run.tensorboard) {
    sinks_.push_back(
        &board_.emplace(folder_->tensorboard(), WriteConfig(config_), progress_.samples));
  }
  if (!quiet) sinks_.push_back(&bar_.emplace(config_.run.samples));
}

bool Run::LostPatience() const {
  return config_.run.patience > 0 && progress_.best.since >= config_.run.patience;
}

/// Step, after which, should another process be lost, the state before it is saved.
std::optional<double> Run::StepOrRescue(SampleSource& source, const InterruptGuard& guard) {
  if (group_.size() == 1) return Step(source, guard);
  const at::Tensor buffers = learner_.flat.buffers().clone();
  try {
    return Step(source, guard);
  } catch (const LostProcess& e) {
    learner_.flat.buffers().copy_(buffers);
    if (folder_ != nullptr && saved_ != progress_.samples) SaveAlone();
    throw LostProcess(fmt::format(
        "after {} samples: {}: --resume continues the run, with any number of processes",
        progress_.samples, e.what()));
  }
}

/// Whether any of the processes was.
bool Run::Interrupted(const InterruptGuard& guard) {
  signal_ = guard.Signal();
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

LossShare Run::ShareOf(const Batch& slice) {
  if (group_.size() == 1) return {};
  LossShare share;
  share.procrustes =
      static_cast<double>(slice.depth.size(0)) / static_cast<double>(config_.run.batch_size);
  const double own = loss_.WeightOf(slice.labels);
  const at::Tensor all = at::zeros({1}, at::kDouble).fill_(own);
  group_.Sum(all);
  share.segmentation = own / std::max(all.item<double>(), 1e-12);
  return share;
}

/// The loss, or nothing where a process was interrupted.
std::optional<double> Run::Step(SampleSource& source, const InterruptGuard& guard) {
  const auto start = Clock::now();
  if (Interrupted(guard)) return std::nullopt;
  const std::vector<Sample> drawn = source.Next();
  const std::int64_t samples =
      group_.size() == 1 ? static_cast<std::int64_t>(drawn.size()) : config_.run.batch_size;
  const Batch batch = Collate(drawn).To(compute_.device);
  StepReport report;
  const LossShare share = ShareOf(batch);
  report.times.data = Seconds(start);
  // Micro-batches of several processes differ in number, so that they cannot agree between them.
  const bool alone = group_.size() == 1;
  const at::Tensor buffers =
      alone && config_.run.micro_batch > 0 ? learner_.flat.buffers().clone() : at::Tensor();
  at::Tensor norm;
  try {
    norm = ComputeGradient(learner_, loss_, batch, compute_, progress_.samples,
                           config_.run.micro_batch, &report, share, reducer_ ? &*reducer_ : nullptr,
                           [&] {
                             if (alone && Interrupted(guard)) throw Interruption();
                           });
  } catch (const Interruption&) {
    learner_.flat.buffers().copy_(buffers);
    return std::nullopt;
  }
  progress_.NoteCameras(drawn);
  RequireFinite(report, samples);
  const auto updating = Clock::now();
  progress_.lr = LearningRate(config_.optim, progress_.samples, config_.run.samples);
  learner_.Update(progress_.lr, norm);
  Synchronize(compute_.device);
  report.times.optim = Seconds(updating);
  progress_.samples += samples;
  progress_.means.Add(report, samples);
  return report.loss;
}

/// Before the weights change, so that no bad step ever reaches them.
void Run::RequireFinite(const StepReport& report, std::int64_t samples) const {
  if (std::isfinite(report.loss) && std::isfinite(report.gradient_norm)) return;
  throw Error(fmt::format(
      "step {} (samples {} to {}): loss {} with gradient norm {}: lower optim.lr or set "
      "optim.clip_norm; the last good state is {}",
      learner_.optimizer.steps() + 1, progress_.samples, progress_.samples + samples - 1,
      report.loss, report.gradient_norm,
      folder_ != nullptr && saved_ >= 0 ? folder_->State(saved_).string() : "none"));
}

void Run::WriteTrainRow() {
  const TrainRow row =
      progress_.means.Take(learner_.optimizer.steps(), progress_.samples, progress_.lr);
  for (MetricSink* sink : sinks_) sink->Train(row);
}

/// Nothing where a process was interrupted.
std::optional<ValidationResult> Run::ValidateNow(const InterruptGuard& guard) {
  if (config_.run.validation_samples == 0) {
    progress_.validated = progress_.samples;
    return ValidationResult();
  }
  learner_.average.Refresh(learner_.flat);
  const std::unique_ptr<SampleSource> opened = data_.open_validation();
  Interruptible source(*opened, [&] { return Interrupted(guard); });
  ValidationResult own;
  try {
    own = Validate(learner_.average.net(), loss_, data_.structure,
                   ParseKeypointKind(config_.loss.keypoints), source, OwnValidationSamples(),
                   compute_.device, compute_.channels_last);
  } catch (const Interruption&) {
    return std::nullopt;
  }
  progress_.validated = progress_.samples;
  ValidationResult result = ShareValidation(group_, own, config_.run.batch_size);
  for (MetricSink* sink : sinks_) {
    sink->Validation({learner_.optimizer.steps(), progress_.samples, result});
  }
  if (progress_.best.Note(config_.run.best_metric, result, progress_.samples)) {
    ShareCameras(group_, &progress_);
    if (folder_ != nullptr) {
      SaveModel(folder_->best(), config_, data_, learner_, progress_);
    }
  }
  return result;
}

int Run::OwnValidationSamples() const {
  const int all = config_.run.validation_samples;
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
  SaveState(folder_->State(progress_.samples), config_, data_.identity, compute_, learner_,
            progress_);
  folder_->KeepStates(config_.run.keep_states);
  SaveModel(folder_->model(), config_, data_, learner_, progress_);
}

}  // namespace volalign
