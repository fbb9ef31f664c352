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
#include "infer/initial/initial_pose.h"
#include "infer/lens/sensor_lens.h"
#include "infer/refine/refine.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A sensor's lens.
struct LensOutcome {
  LensSource source = LensSource::kGiven;
  /// Standard deviations of the logarithm of the focal length, of k1 and of k2.
  Eigen::Vector3d sigmas = Eigen::Vector3d::Zero();
};

/// The outcome of one sensor. A failed one has a code, a reason, a hint and no pose. A weak one has
/// a pose and a reason for care. The quality is at the reported pose, of the structure as built.
/// For a sensor that disagrees with the others it is of the structure as that sensor shows it.
struct SensorOutcome : Finding, PoseQuality {
  std::string name;
  SensorStatus status = SensorStatus::kFailed;
  std::optional<Pose> structure_from_sensor;
  Pose initial = Pose::Identity();  ///< of a placed sensor
  PoseSource initial_source = PoseSource::kNetwork;
  /// The pose that the others would give a sensor that disagrees with them. structure_from_sensor
  /// is then its own pose.
  std::optional<Pose> together;
  std::vector<std::string> disagrees_with;  ///< sensors that show it, the clearest first
  /// RefinedFrame::disagreement.
  double disagreement = 0;
  /// Its prior, in the frame of structure_from_sensor; prior_used: the pose uses it.
  std::optional<Pose> prior;
  bool prior_used = false;
  double initial_rms_to_structure_m = 0;
  Matrix6d covariance = Matrix6d::Zero();
  /// True depth = measured depth * depth_gain + depth_offset_m. They are 1 and 0 if the capture
  /// does not tell. Residuals are corrected by it. The sigmas are posterior ones in either case.
  double depth_offset_m = 0, depth_gain = 1;
  double sigma_depth_offset_m = 0, sigma_depth_gain = 0;
  std::optional<PoseError> error, initial_error;  ///< if there is a ground truth

  int quarter_turns = 0;

  Intrinsics intrinsics;        ///< through which the pose was found
  Intrinsics intrinsics_given;  ///< as in the capture
  LensOutcome lens;

  /// Standard deviations of the position along the structure's axes, m; NaN if it is not placed.
  Eigen::Vector3d sigma_position_m() const {
    if (!structure_from_sensor)
      return Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    return SigmaPosition(*structure_from_sensor, covariance);
  }
  Eigen::Vector3d sigma_rotation_deg() const { return SigmaRotationDeg(covariance); }
};

/// The outcome of a frame, with its images.
struct FrameResult : SensorOutcome {
  SegmentationResult segmentation;  ///< full size
  SensorView view;                  ///< depths as measured, and rays
  std::optional<Pose> best_guess;   ///< the rejected pose of a failed sensor
};

/// Demotes a sensor with numbers that are not finite, which no solver should leave. It becomes
/// failed, without a pose, if its pose is one of them. Else it becomes weak, and `reason` names
/// them. Files have the others' poses, and its own without these numbers.
void DemoteIfNotFinite(SensorOutcome* sensor);

/// Two placed sensors of one capture.
struct PairResult {
  std::string a, b;
  double overlap = 0;  ///< share of both sensors' sampled points that the other one sees too
  /// Root mean square distance of the points that both see: as measured, and as the errors of
  /// depths and poses predict. NaN: too few.
  double rms_m = std::numeric_limits<double>::quiet_NaN();
  double predicted_rms_m = std::numeric_limits<double>::quiet_NaN();
  /// Covariance of b's delta less a's (see SensorOutcome::covariance). NaN: not known.
  Matrix6d covariance = Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN());
  /// Largest standard deviations of b's position, m, and rotation, deg, relative to a. NaN: not
  /// known.
  double sigma_m = std::numeric_limits<double>::quiet_NaN();
  double sigma_deg = std::numeric_limits<double>::quiet_NaN();

  bool overlaps() const { return std::isfinite(rms_m); }
};

/// A sensor in another set of the rig's poses.
struct SensorAlternative {
  std::string name;
  /// Number for `calibrate --choose NAME=NUMBER`.
  int number = 0;
  /// The candidate before refinement.
  Pose structure_from_sensor = Pose::Identity();
};

/// Another set of poses that explains the frames. Sensors that are not in it keep their poses.
struct RigAlternative {
  double log_odds = 0;  ///< natural logarithm, of the reported poses against this set
  std::string capture;  ///< name of the capture with this choice, if there are several
  std::vector<SensorAlternative> sensors;
};

/// The end of the joint solution.
struct SolveReport {
  int rounds = 0;  ///< number of joint refinements
  /// All frames have FrameSolution::settled.
  bool settled = false;
  bool converged = false;  ///< the last one ended by its tolerances, not by its most iterations
  double moved_m = 0;      ///< m: largest move of a sensor in the last one
  double moved_px = 0;     ///< px: largest move of a picture by the change of its lens
};

/// Sensors and the stack that they saw.
struct StackResult {
  std::vector<FrameResult> sensors;
  std::vector<PairResult> pairs;
  std::vector<RigAlternative> alternatives;  ///< the most probable first
  std::optional<SetDistances> metrics;       ///< absent when no sensor was placed
  std::optional<AssemblyReport> assembly;    ///< absent if options exclude it
  /// The structure with the boxes and the size as the capture shows them. Residuals and d1, d2
  /// refer to it. It is the nominal one if nothing was estimated.
  Structure built;
  std::vector<RefinedBox> boxes;  ///< of Structure::boxes()

  int placed() const;  ///< number of sensors
};

/// One capture's part of the result. Its geometry is in the structure where it stood then.
struct CaptureResult : StackResult {
  std::string name;
  Pose first_from_placement = Pose::Identity();
  /// Covariance of delta, as for a pose; zero for the first capture.
  Matrix6d covariance = Matrix6d::Zero();
};

/// The result of all captures: figures of all together, poses and boxes of the first.
struct CalibrationResult : StackResult, RefinedSize {
  SolveReport solve;
  std::vector<std::pair<std::string, double>> timings_s;
  std::vector<RigFinding> findings;  ///< reasons to doubt all of it, the likeliest first
  /// Each of several captures, with its images, which `sensors` then do not have. Empty for a
  /// single capture.
  std::vector<CaptureResult> captures;

  /// The worst of the sensors' statuses; with findings, weak at best.
  SensorStatus verdict() const;
};

}  // namespace volalign
