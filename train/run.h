#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/base/interrupt.h"
#include "train/batch.h"
#include "train/compute.h"
#include "train/distributed/process_group.h"
#include "train/learner.h"
#include "train/log/run_folder.h"
#include "train/log/sinks.h"
#include "train/losses.h"
#include "train/state.h"
#include "train/step.h"
#include "train/trainer.h"

namespace volalign {

/// A running training with its parts. Only rank 0 of several processes has a folder; the others
/// have nullptr. All references have to outlive the run. Every process calls the same functions:
/// Begin, then, as long as these return true, Ready and Advance in turn, then End.
class Run {
 public:
  /// Continues `state`, or starts at the first sample, up to options.stop_at_samples.
  Run(const TrainingData& data, const TrainConfig& config, const Compute& compute,
      ProcessGroup& group, const RunFolder* folder, std::optional<SavedState> state,
      const TrainOptions& options, const InterruptGuard& guard);

  /// Writes to stderr, in rank 0 of a run that is not quiet.
  void Say(const std::string& sentence);
  /// Samples drawn so far: the index of the next batch's first.
  std::int64_t samples() const { return progress_.samples; }
  /// Repeats a validation that was interrupted. False if it is interrupted again, or no sample is
  /// left.
  bool Begin();
  /// To be called before a batch is drawn, which may take long. False: the run was interrupted.
  bool Ready();
  /// A step with the validation and saving that are due after it. False: interrupted, or no sample
  /// is left.
  bool Advance(const Batch& batch);
  TrainResult End();
  /// The message if the device's memory is too small.
  std::string OutOfMemory() const;

 private:
  using Clock = std::chrono::steady_clock;
  void Lead(std::optional<SavedState> state, const TrainOptions& options);
  bool Interrupted();
  bool OwesValidation() const;
  bool ValidateIfOwed();
  template <class F>
  bool Rescued(const F& f);
  bool Step(const Batch& batch);
  void Note(const StepNumbers& numbers, const StepTimes& times, std::int64_t samples);
  void Collect();
  void Foretell();
  void WriteTrainRow();
  std::string LastState() const;
  std::optional<ValidationResult> ValidateNow();
  int OwnValidationSamples() const;
  void Save();
  void SaveAlone();
  const TrainingData& data_;
  const TrainConfig& config_;
  ProcessGroup& group_;
  const RunFolder* folder_;
  const InterruptGuard& guard_;
  Compute compute_;
  std::int64_t stop_;
  Learner learner_;
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
  Clock::time_point ended_;         ///< end of the last step, with validation and saving
  std::int64_t timed_samples_ = 0;  ///< number of samples in the steps of this call,
  double timed_s_ = 0;              ///< and their time
  bool foretold_ = false;
  int signal_ = 0;              ///< the signal that interrupted the run
  std::int64_t saved_ = -1;     ///< samples of the newest state
  std::int64_t modelled_ = -1;  ///< samples of the model.safetensors that this process wrote
  std::optional<JsonlSink> jsonl_;
  std::optional<TensorBoardSink> board_;
  std::optional<ProgressSink> bar_;
  std::vector<MetricSink*> sinks_;
};

}  // namespace volalign
