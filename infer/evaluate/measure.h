#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "infer/calib/calibrate.h"
#include "infer/checks/outcome.h"
#include "infer/evaluate/items.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// Calibration options to compare, e.g. {"paper", ...} and {"network", ...}.
struct EvaluationVariant {
  std::string name;
  CalibrateOptions options;
};

/// Errors of the estimated poses.
struct EvaluatedErrors {
  PoseError initial, refined;
  /// [translation; rotation vector], m and rad, that takes the refined pose to the true one
  /// (PerturbLeft). The covariance is of it.
  Vector6d delta = Vector6d::Zero();
};

/// One sensor's outcome. Errors and intervals are there if the sensor was placed and has a ground
/// truth.
struct EvaluatedSensor {
  std::string name;
  SensorStatus status = SensorStatus::kFailed;
  SensorCode code = SensorCode::kNone;
  int sides = 0;
  /// Do the sides that it truly sees in one capture, each with kFewestSidePixels, fix six degrees
  /// of freedom (SidesFixPose)?
  std::optional<bool> sides_fix_pose;
  double initial_rms_to_structure_m = 0, rms_to_structure_m = 0, inlier_share = 0;

  /// `built`: as compared with the true pose in the frame in which the boxes' displacements average
  /// out.
  std::optional<EvaluatedErrors> nominal, built;
  Vector6d sigma = Vector6d::Zero();  ///< square roots of the covariance's diagonal, m and rad

  bool placed() const { return status != SensorStatus::kFailed; }
};

/// One capture, or those of several placements together, under one variant.
struct EvaluatedCase {
  std::string fingerprint;  ///< of the item, the variant, the model and the program
  std::string rig, sensors, variant;
  std::optional<std::uint64_t> seed;
  std::vector<EvaluatedSensor> results;
  std::map<std::string, double> timings_s;
  int placements = 1;
};

/// The options that `compare` ("initial.method=paper,network") sets over `source`, each named after
/// its value, in order. Without it one variant, "volalign", with `source` alone. Throws
/// ConfigError.
std::vector<EvaluationVariant> ReadVariants(const ConfigSource& source, const std::string& compare);

/// Calibrates a capture, or all placements together, under each variant. Poses are compared in the
/// frame of the first capture.
std::vector<EvaluatedCase> EvaluateCapture(const EvaluationCapture& capture,
                                           const std::vector<EvaluationVariant>& variants,
                                           Segmenter& segmenter);

}  // namespace volalign
