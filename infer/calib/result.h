#pragma once

#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/checks/assembly.h"
#include "infer/checks/outcome.h"
#include "infer/checks/rig_findings.h"
#include "infer/checks/verdict.h"
#include "infer/initial/pose_choice.h"
#include "infer/lens/sensor_lens.h"
#include "infer/refine/refine.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What is known about a sensor's lens.
struct LensOutcome {
  LensSource source = LensSource::kGiven;
  /// Standard deviations of the logarithm of the focal length, of k1 and of k2.
  Eigen::Vector3d sigmas = Eigen::Vector3d::Zero();
};

/// One sensor's outcome. Failed: code, reason and hint, no pose. Weak: a pose, and what to be wary
/// of. The quality is a placed sensor's, at the reported pose, of the structure as built; as it saw
/// it itself where it disagrees with the others.
struct SensorOutcome : Finding, PoseQuality {
  std::string name;
  SensorStatus status = SensorStatus::kFailed;
  std::optional<Pose> structure_from_sensor;
  Pose initial = Pose::Identity();  ///< of a placed sensor
  PoseSource initial_source = PoseSource::kNetwork;
  /// Of a sensor that disagrees with the others: the pose that they would give it. The one that
  /// counts, structure_from_sensor, is then its own pose.
  std::optional<Pose> together;
  std::vector<std::string> disagrees_with;  ///< the sensors that show it, the clearest first
  /// RefinedFrame::disagreement.
  double disagreement = 0;
  double initial_rms_to_structure_m = 0;
  Matrix6d covariance = Matrix6d::Zero();
  /// True depth = measured depth * depth_gain + depth_offset_m; 1 and 0 where the capture does not
  /// tell. Residuals are corrected by it. The sigmas are posterior ones in either case.
  double depth_offset_m = 0, depth_gain = 1;
  double sigma_depth_offset_m = 0, sigma_depth_gain = 0;
  std::optional<PoseError> error, initial_error;  ///< where there is a ground truth

  int quarter_turns = 0;

  Intrinsics intrinsics;        ///< that the pose belongs to
  Intrinsics intrinsics_given;  ///< by the capture
  LensOutcome lens;

  /// Of its position, along the structure's axes; NaN where it is not placed.
  Eigen::Vector3d sigma_position_m() const {
    if (!structure_from_sensor)
      return Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    return SigmaPosition(*structure_from_sensor, covariance);
  }
  Eigen::Vector3d sigma_rotation_deg() const { return SigmaRotationDeg(covariance); }
};

/// The outcome of a frame, with the images that it comes from.
struct FrameResult : SensorOutcome {
  SegmentationResult segmentation;  ///< full size
  SensorView view;                  ///< the frame as it was used: depths as measured, and rays
  std::optional<Pose> best_guess;   ///< of a failed sensor, the pose that was tried and rejected
};

/// For a sensor with numbers that are not finite, which no solver should leave: failed, without a
/// pose, if its pose is one of them; else weak at best, and `reason` names them. The files have
/// the others' poses, and its own without these numbers.
void DemoteIfNotFinite(SensorOutcome* sensor);

/// Two placed sensors of one still.
struct PairResult {
  std::string a, b;
  double overlap = 0;  ///< share of the sampled points, of both, that the other one sees too
  /// Distance of the points that both see, root mean square: as measured, and as the errors of both
  /// depths and of the poses let expect. NaN: too few.
  double rms_m = std::numeric_limits<double>::quiet_NaN();
  double predicted_rms_m = std::numeric_limits<double>::quiet_NaN();
  /// Of the poses to each other: of delta of b less that of a (see SensorOutcome::covariance). NaN:
  /// not known.
  Matrix6d covariance = Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN());
  /// Standard deviations of where b is as a has it, m, in the direction in which that is known
  /// least, and of how it is turned, deg. NaN: not known.
  double sigma_m = std::numeric_limits<double>::quiet_NaN();
  double sigma_deg = std::numeric_limits<double>::quiet_NaN();

  bool overlaps() const { return std::isfinite(rms_m); }
};

/// A sensor in a set of poses that the rig may have instead.
struct SensorAlternative {
  std::string name;
  /// By which `calibrate --choose NAME=NUMBER` chooses it; 0 of one that follows others.
  int number = 0;
  /// As it was chosen among, before refinement; of one that rests on others (by_neighbours), where
  /// it would follow them.
  Pose structure_from_sensor = Pose::Identity();
};

/// Another set of poses that explains the frames: sensors that are not in it stay where they are.
struct RigAlternative {
  double log_odds = 0;  ///< natural logarithm, of the reported poses against this set
  std::string still;    ///< of several stills, whose choice it is
  std::vector<SensorAlternative> sensors;
};

/// How the joint solution ended.
struct SolveReport {
  int rounds = 0;  ///< joint refinements, each from other labels, frames or lenses
  /// The last one ended by its tolerances and moved no sensor by more than its sigma.
  bool settled = false;
  bool converged = false;  ///< it ended by its tolerances, not by the most iterations
  double moved_m = 0;      ///< how far it moved the sensor that it moved farthest
  double moved_px = 0;     ///< how far the last change of a lens moved a picture
};

/// Sensors and the stack that they saw.
struct StackResult {
  std::vector<FrameResult> sensors;
  std::vector<PairResult> pairs;
  std::vector<RigAlternative> alternatives;  ///< the most probable first
  std::optional<SetDistances> metrics;       ///< absent when no sensor was placed
  std::optional<AssemblyReport> assembly;    ///< absent when it was not to be asked
  /// The structure with its boxes where the capture shows them and the size that it shows, which
  /// residuals and d1, d2 refer to; the nominal one where nothing was estimated.
  Structure built;
  std::vector<RefinedBox> boxes;  ///< of Structure::boxes()
};

/// One still's part of a result of several; what is geometry, in the structure where it stood then.
struct StillResult : StackResult {
  std::string name;
  Pose first_from_placement = Pose::Identity();
  /// Of delta as of a pose's; zero of the first still.
  Matrix6d covariance = Matrix6d::Zero();
};

/// Of several stills: figures of all together, poses and boxes of the first.
struct CalibrationResult : StackResult {
  SolveReport solve;
  std::vector<std::pair<std::string, double>> timings_s;
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;
  std::vector<RigFinding> findings;  ///< what makes all of it doubtful, the likeliest cause first
  /// Of several stills, each, with its images, which `sensors` then have none of. Empty where there
  /// is only one.
  std::vector<StillResult> stills;

  /// The worst of the sensors' statuses; where there are findings, weak at best.
  SensorStatus verdict() const;
  int placed() const;
};

}  // namespace volalign
