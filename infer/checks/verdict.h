#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/base/odds.h"
#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "infer/checks/free_space.h"
#include "infer/checks/outcome.h"
#include "infer/checks/pose_quality.h"
#include "infer/refine/refine.h"
#include "infer/view/alike.h"

namespace volalign {

/// Requirements on a sensor. Shares are of pixels that confirm or contradict the pose, so that
/// neither a near nor a far sensor is favoured.
struct VerdictOptions {
  double max_sigma_position_m = 0.25;  ///< for the own pose of a placed sensor
  // For the reported pose of a sensor that is ok:
  double weak_inlier_share = 0.9;
  double weak_label_iou = 0.5;  ///< intersection over union of labels; not a key
  double weak_rms_m = kSamePlace;
  double weak_sigma_position_m = kSamePlace;
  double weak_sigma_rotation_deg = 1.5;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("max_sigma_position_m", max_sigma_position_m,
       "standard deviation of the position in the worst direction, m, above which a sensor's own "
       "view does not determine a pose",
       Above(0), FormerlyNamed("max_sigma_translation_m"));
    ar("weak_inlier_share", weak_inlier_share, "inlier share below which a placed sensor is weak",
       Between(0, 1));
    ar("weak_rms_m", weak_rms_m, "RMS to the structure, m, above which a placed sensor is weak",
       Above(0));
    ar("weak_sigma_position_m", weak_sigma_position_m,
       "standard deviation of the position in the worst direction, m, above which a sensor is weak",
       Above(0), FormerlyNamed("weak_sigma_translation_m"));
    ar("weak_sigma_rotation_deg", weak_sigma_rotation_deg,
       "standard deviation of the rotation about the worst axis, deg, above which a sensor is weak",
       Above(0), Fixed("min_valid_share", 0.01), Fixed("max_median_depth_m", 10),
       Fixed("min_far_depth_m", 0.9), Fixed("sure_confidence", 0.8),
       Fixed("min_sure_area_m2", 0.05), Fixed("many_sides", 4), Fixed("many_sides_area_m2", 0.5),
       Fixed("suspicious_score", 0.85), Fixed("far_off_intrinsics", 0.08),
       Fixed("intrinsics.min_score", 0.8), Fixed("intrinsics.min_gain", 0.08),
       Fixed("intrinsics.min_change", 0.05), Fixed("lens.min_sigmas", 4),
       Fixed("lens.min_bend_m", 0.008), Fixed("lens.max_focal_sigmas", 2.5),
       Fixed("refuting_odds", kDecisiveOdds),
       Removed("max_sigma_by_neighbours_m", "a known pose places such a sensor; leave the key out",
               std::vector<std::string>{"0.03"}),
       Removed("max_sigma_by_neighbours_deg",
               "a known pose places such a sensor; leave the key out",
               std::vector<std::string>{"2"}),
       Fixed("same_place_m", kSamePlace), Fixed("same_direction_deg", 2),
       Fixed("weak_label_iou", 0.5));
  }
};

/// A sensor's view contradicts other sensors.
struct ContradictedSensors {
  std::vector<std::string> names;  ///< sensors that show it, the clearest first
  PoseError apart;                 ///< their pose for it, compared with its own
};

/// Facts about a placed sensor, for its verdict.
struct VerdictFacts {
  PoseQuality quality;                               ///< at the reported pose
  Pose structure_from_sensor = Pose::Identity();     ///< that pose
  Matrix6d covariance = Matrix6d::Zero();            ///< of it
  std::string unsolved;                              ///< RefinedFrame::problem
  std::optional<ContradictedSensors> contradiction;  ///< of other sensors
  std::string same_depth_as;                         ///< a sensor with the same depth map, or empty
  std::optional<Finding> suspect_lens;               ///< where flat surfaces look bent
  std::string other_pose;                            ///< Labelled::other_pose
  double log_odds = 0;                               ///< of the pose against that one, natural
  bool floor_would_tell = true;                      ///< Labelled::floor_would_tell
  std::optional<FreeSpaceViolation> free_space_violation;  ///< FindFreeSpaceViolations
  bool known_turns = false;                                ///< the capture gives its quarter_turns
  std::optional<double> shape_log_odds;                    ///< LocatedFrame::shape_log_odds
  std::string unsettled;  ///< last moves of the joint solution, or empty
};

/// Formats the natural logarithm of odds: "3.2 : 1", "1 : 1.5"; beyond 1000 : 1 "over 1000 : 1".
std::string FormatOdds(double log_odds);

/// The most telling weakness of a placed sensor; nothing if it is ok.
std::optional<Finding> FindWeakness(const VerdictFacts& facts, const VerdictOptions& options);

/// Standard deviations per axis, m and deg, of a covariance of [translation; rotation vector].
/// SigmaTranslation is of a movement about the structure's origin.
Eigen::Vector3d SigmaTranslation(const Matrix6d& covariance);
Eigen::Vector3d SigmaRotationDeg(const Matrix6d& covariance);

/// Covariance of the sensor's position, m^2, from that of delta in PerturbLeft
/// (core/geometry/pose.h).
Eigen::Matrix3d PositionCovariance(const Pose& structure_from_sensor, const Matrix6d& covariance);
/// Its standard deviations along the structure's axes, m.
Eigen::Vector3d SigmaPosition(const Pose& structure_from_sensor, const Matrix6d& covariance);
/// Largest standard deviations of the sensor's position, in its least known direction, m, and of
/// its rotation, about its least known axis, deg. NaN for a covariance that is not finite. Limits
/// apply to these.
double LargestSigmaPosition(const Pose& structure_from_sensor, const Matrix6d& covariance);
double LargestSigmaRotationDeg(const Matrix6d& covariance);

/// Finds sensors that stand in one place: it is one sensor under two names. `poses`: absent for
/// sensors that are not placed. There is one result per sensor, which names the last of its
/// duplicates.
std::vector<std::optional<Finding>> FindDuplicates(const std::vector<std::string>& names,
                                                   const std::vector<std::optional<Pose>>& poses);

}  // namespace volalign
