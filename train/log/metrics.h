#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/base/image.h"

namespace volalign {

/// Wall-clock time of the parts of a step, s.
struct StepTimes {
  double data = 0, forward = 0, loss = 0, backward = 0, optim = 0;
};

inline constexpr std::array<std::pair<const char*, double StepTimes::*>, 5> kStepParts = {
    {{"data", &StepTimes::data},
     {"forward", &StepTimes::forward},
     {"loss", &StepTimes::loss},
     {"backward", &StepTimes::backward},
     {"optim", &StepTimes::optim}}};

double Total(const StepTimes& times);

/// Divides the time of `all` that is not `data` in the proportions of `measured`. For steps whose
/// parts run on a device; one of them was measured.
StepTimes ShareOut(const StepTimes& all, const StepTimes& measured);

/// The measurements of one step, or their sums over several.
struct StepReport {
  std::int64_t steps = 1;
  std::int64_t skipped = 0;             ///< steps with a loss or gradient that is not finite
  double loss = 0;                      ///< from here to gradient_norm: without skipped steps
  std::map<std::string, double> terms;  ///< of the loss, by their names in logs: loss_seg, ...
  std::int64_t degenerate_samples = 0;  ///< samples that added nothing to loss_3d
  double gradient_norm = 0;             ///< before clipping
  StepTimes times;
};

/// The metrics of a sample whose predicted keypoints determine a pose.
inline constexpr const char *kKeypointRmse = "keypoint_rmse_m",
                            *kTranslationError = "translation_error_m",
                            *kRotationError = "rotation_error_deg";

/// One validation sample.
struct SampleScore {
  std::string sensor;  ///< pool name
  double rho_m = 0;    ///< horizontal distance of the sensor from the structure's origin
  /// By name: loss_seg, those of train/metric.h, and those of a pose if there is one.
  std::map<std::string, double> metrics;
};

/// A sample with the network's labels, for people.
struct LabelExample {
  DepthImage depth;
  LabelImage labels, predicted;
};

struct ValidationResult {
  int samples = 0;
  int samples_with_pose = 0;  ///< their predicted keypoints determine a pose
  /// By their names in files. Means over the samples that have the metric, and of the terms of the
  /// loss. Medians of the errors of poses (median_translation_error_m, median_rotation_error_deg).
  std::map<std::string, double> means;
  std::vector<SampleScore> scores;     ///< of each sample, in order
  std::vector<LabelExample> examples;  ///< the first samples

  /// 0 if no sample has the metric.
  double Mean(const std::string& name) const;
};

/// The medians over the samples with a pose as text: "12.3 cm, 0.45 deg", or "-" without any.
std::string MedianPoseError(const ValidationResult& result);

/// The best of the validations so far, by miou.
struct BestValidation {
  std::int64_t samples = -1;  ///< samples before it; -1: there is none
  double value = 0;

  /// Considers a validation. Returns true if it is the best; the earlier of equal ones stays.
  bool Note(const ValidationResult& result, std::int64_t at_samples);
};

/// A row of the training's log: means over the steps since the previous row.
struct TrainRow {
  std::int64_t step = 0, samples = 0;  ///< so far
  double lr = 0;                       ///< of the last step
  double samples_per_s = 0;            ///< over the steps alone, without validation and saving
  StepReport mean;  ///< except `steps`, `skipped` and `degenerate_samples`, which are sums
};

struct ValidationRow {
  std::int64_t step = 0, samples = 0;
  ValidationResult result;
};

/// Sums over the steps since the last TrainRow.
struct StepMeans {
  std::int64_t samples = 0;
  StepReport sum;

  StepMeans() { sum.steps = 0; }

  void Add(const StepReport& more, std::int64_t more_samples);
  /// The means; begins again.
  TrainRow Take(std::int64_t step, std::int64_t samples_so_far, double lr);
};

}  // namespace volalign
