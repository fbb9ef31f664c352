#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/base/interrupt.h"
#include "train/compute.h"
#include "train/distributed/gradient_reducer.h"
#include "train/distributed/process_group.h"
#include "train/learner.h"
#include "train/log/run_folder.h"
#include "train/log/sinks.h"
#include "train/log/tensorboard_sink.h"
#include "train/losses.h"
#include "train/state.h"
#include "train/trainer.h"

namespace volalign {

/// A run at work: its parts, and what joins them. Of several processes rank 0 alone has a folder,
/// and the others nullptr. All that is given by reference outlives the run.
class Run {
 public:
  /// Continues `state`, or starts at the first sample. Every process calls the same functions.
  Run(const TrainingData& data, const TrainConfig& config, const Compute& compute,
      ProcessGroup& group, const RunFolder* folder, std::optional<SavedState> state, bool quiet);

  /// On stderr, in rank 0 of a run that is not quiet.
  void Say(const std::string& sentence);
  /// Up to `stop` samples, or an interruption.
  TrainResult Train(std::int64_t stop);

 private:
  void Lead(std::optional<SavedState> state, bool quiet);
  bool LostPatience() const;
  bool Interrupted(const InterruptGuard& guard);
  bool OwesValidation() const;
  std::optional<double> StepOrRescue(SampleSource& source, const InterruptGuard& guard);
  std::optional<double> Step(SampleSource& source, const InterruptGuard& guard);
  LossShare ShareOf(const Batch& slice);
  void RequireFinite(const StepReport& report, std::int64_t samples) const;
  void WriteTrainRow();
  std::optional<ValidationResult> ValidateNow(const InterruptGuard& guard);
  int OwnValidationSamples() const;
  void Save();
  void SaveAlone();
  const TrainingData& data_;
  const TrainConfig& config_;
  ProcessGroup& group_;
  const RunFolder* folder_;
  Compute compute_;
  Learner learner_;
  TrainingLoss loss_;
  std::optional<GradientReducer> reducer_;
  RunProgress progress_;
  int signal_ = 0;              ///< that interrupted the run
  std::int64_t saved_ = -1;     ///< samples of the newest state
  std::int64_t modelled_ = -1;  ///< samples of the model.pt that this process wrote
  std::optional<JsonlSink> jsonl_;
  std::optional<TensorBoardSink> board_;
  std::optional<ProgressSink> bar_;
  std::vector<MetricSink*> sinks_;
};

}  // namespace volalign
