#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/base/odds.h"
#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "infer/checks/intrinsics_check.h"
#include "infer/checks/outcome.h"
#include "infer/checks/pose_quality.h"
#include "infer/refine/refine.h"
#include "infer/view/alike.h"

namespace volalign {

/// When large planes, or the focal length that was estimated, tell that the intrinsics are wrong.
struct LensCheckOptions {
  double min_sigmas = 4;
  double min_bend_m = 0.008;
  double max_focal_sigmas = 2.5;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("min_sigmas", min_sigmas,
       "standard deviations by which the lens that makes large planes flat has to differ from the "
       "one that is used",
       Above(0));
    ar("min_bend_m", min_bend_m, "how far, m, it has to bend them", Above(0));
    ar("max_focal_sigmas", max_focal_sigmas,
       "standard deviations of its prior by which a focal length may come out other than given; "
       "one in 80 that is as the prior has it exceeds 2.5",
       Above(0));
  }
};

/// What a sensor has to show. Shares are of pixels that confirm or contradict the pose, so that
/// neither a near nor a far sensor is favoured.
struct VerdictOptions {
  // Of the frame.
  double min_valid_share = 0.01;
  double max_median_depth_m = 10;
  double min_far_depth_m = 0.9;
  // Of what was labelled, before there is a pose.
  double sure_confidence = 0.8;
  double min_sure_area_m2 = 0.05;
  int many_sides = 4;
  double many_sides_area_m2 = 0.5;
  double suspicious_score = 0.85;
  double far_off_intrinsics = 0.08;
  IntrinsicsCheckOptions intrinsics;
  LensCheckOptions lens;
  // Of the sensor's own pose, for it to be placed.
  double refuting_odds = kDecisiveOdds;
  double max_sigma_position_m = 0.25;
  // Of a pose that neighbours give to a sensor whose own view fixes none.
  double max_sigma_by_neighbours_m = kRoughPose;
  double max_sigma_by_neighbours_deg = 2;
  // Of the reported pose, for the sensor to be ok.
  double weak_inlier_share = 0.9;
  double weak_label_iou = 0.5;
  double weak_rms_m = kSamePlace;
  double weak_sigma_position_m = kSamePlace;
  double weak_sigma_rotation_deg = 1.5;
  double same_place_m = kSamePlace;
  double same_direction_deg = 2;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("min_valid_share", min_valid_share,
       "least share of pixels with depth; below it: failed, no_depth", Between(0, 1));
    ar("max_median_depth_m", max_median_depth_m,
       "largest median depth, m, of a frame in a room; above it: failed, wrong_units", Above(0));
    ar("min_far_depth_m", min_far_depth_m,
       "depth, m, that one pixel in twenty has to exceed, since nearer than that no sensor sees a "
       "structure; otherwise: failed, wrong_units",
       AtLeast(0));
    ar("sure_confidence", sure_confidence,
       "mean probability of a side's labels from which on the network is sure of the side",
       Between(0, 1));
    ar("min_sure_area_m2", min_sure_area_m2,
       "least area, m^2, of sides that the network is sure of, for a frame without a pose to show "
       "a structure at all; below it: failed, no_structure rather than degenerate_sides",
       AtLeast(0));
    ar("many_sides", many_sides,
       "sides that the network is sure of from which on a misfit is put down to the stack or the "
       "intrinsics rather than to what else is in the room",
       AtLeast(1));
    ar("many_sides_area_m2", many_sides_area_m2,
       "least area of these sides, m^2; a structure that is seen from one corner shows over 1",
       AtLeast(0));
    ar("suspicious_score", suspicious_score,
       "agreement of many sides with the structure below which other intrinsics are tried",
       Between(0, 1));
    ar("far_off_intrinsics", far_off_intrinsics,
       "error of the intrinsics, in focal lengths, from which on a pose is decimetres off: failed, "
       "intrinsics_suspect rather than weak",
       Above(0));
    ar("intrinsics", intrinsics, "when other intrinsics are believed");
    ar("lens", lens, "when the lens is not the one that the intrinsics describe");
    ar("refuting_odds", refuting_odds,
       "odds of a wrong pose to the right one from which on what was measured behind the "
       "structure refutes a pose; together with what the labels name, 1 is enough",
       AtLeast(1));
    ar("max_sigma_position_m", max_sigma_position_m,
       "standard deviation of the sensor's position in the direction in which it is known least, "
       "m, above which its own view fixes no pose",
       Above(0), FormerlyNamed("max_sigma_translation_m"));
    ar("max_sigma_by_neighbours_m", max_sigma_by_neighbours_m,
       "standard deviation of the sensor's position in the direction in which it is known least, "
       "m, above which overlap with placed sensors does not fix the pose of a sensor whose own "
       "view "
       "leaves it open",
       Above(0));
    ar("max_sigma_by_neighbours_deg", max_sigma_by_neighbours_deg,
       "standard deviation of its rotation about the axis about which it is known least, deg, "
       "above which it does not",
       Above(0));
    ar("weak_inlier_share", weak_inlier_share, "inlier share below which a placed sensor is weak",
       Between(0, 1));
    ar("weak_label_iou", weak_label_iou,
       "that intersection over union below which a placed sensor is weak", Between(0, 1));
    ar("weak_rms_m", weak_rms_m, "RMS to the structure, m, above which a placed sensor is weak",
       Above(0));
    ar("weak_sigma_position_m", weak_sigma_position_m,
       "standard deviation of the sensor's position in the direction in which it is known least, "
       "m, above which it is weak",
       Above(0), FormerlyNamed("weak_sigma_translation_m"));
    ar("weak_sigma_rotation_deg", weak_sigma_rotation_deg,
       "standard deviation of its rotation about the axis about which it is known least, deg, "
       "above which it is weak",
       Above(0));
    ar("same_place_m", same_place_m,
       "distance, m, below which two sensors with one direction are one sensor under two names",
       AtLeast(0));
    ar("same_direction_deg", same_direction_deg,
       "angle, deg, below which two sensors in one place are one sensor under two names",
       AtLeast(0));
  }
};

/// What a sensor saw is not what others saw.
struct ContradictedSensors {
  std::vector<std::string> names;  ///< those that show it, the clearest first
  PoseError apart;                 ///< the pose that they would give it, from its own
};

/// What it and another sensor measured beside the structure refutes its pose.
struct RefutedByPair {
  std::string name;     ///< of the other sensor
  double share = 0;     ///< SeenThrough::share
  double log_odds = 0;  ///< SeenThrough::log_odds
};

/// What is known about a placed sensor when it is judged.
struct VerdictFacts {
  PoseQuality quality;                               ///< at the reported pose
  Pose structure_from_sensor = Pose::Identity();     ///< that pose
  Matrix6d covariance = Matrix6d::Zero();            ///< of it
  std::string unsolved;                              ///< RefinedFrame::problem
  std::optional<ContradictedSensors> contradiction;  ///< of other sensors
  std::string same_depth_as;                         ///< a sensor with the same depth map, or empty
  std::optional<Finding> suspect_intrinsics;         ///< where others fit better
  std::optional<Finding> suspect_lens;               ///< where flat surfaces look bent
  std::optional<Finding> by_neighbours;              ///< LocatedFrame::by_neighbours
  std::string other_pose;                            ///< Labelled::other_pose
  double log_odds = 0;                               ///< of the pose against that one, natural
  bool floor_would_tell = true;                      ///< Labelled::floor_would_tell
  std::optional<RefutedByPair> seen_through;         ///< FindSeenThrough
  bool known_turns = false;                          ///< the capture gives its quarter_turns
  std::optional<double> shape_log_odds;              ///< LocatedFrame::shape_log_odds
  std::string unsettled;  ///< how the joint solution still moved it; or empty
};

/// Of a natural logarithm: "3.2 : 1", "1 : 1.5"; from 1000 : 1 on "over 1000 : 1".
std::string FormatOdds(double log_odds);

/// Of a placed sensor: nothing if it is ok, or the first thing that makes it weak, the most
/// telling first.
std::optional<Finding> FindWeakness(const VerdictFacts& facts, const VerdictOptions& options);

/// Standard deviations per axis, from a covariance of [translation; rotation vector], m and deg.
/// SigmaTranslation is of a movement about the structure's origin.
Eigen::Vector3d SigmaTranslation(const Matrix6d& covariance);
Eigen::Vector3d SigmaRotationDeg(const Matrix6d& covariance);

/// Covariance of the sensor's position, from that of delta in core/geometry/pose.h, PerturbLeft.
Eigen::Matrix3d PositionCovariance(const Pose& structure_from_sensor, const Matrix6d& covariance);
/// Its standard deviations along the structure's axes, m.
Eigen::Vector3d SigmaPosition(const Pose& structure_from_sensor, const Matrix6d& covariance);
/// Standard deviations in the direction in which the sensor's position, and about the axis about
/// which its rotation, is known least, m and deg; NaN for a covariance that is not finite. These
/// are what limits are for.
double LargestSigmaPosition(const Pose& structure_from_sensor, const Matrix6d& covariance);
double LargestSigmaRotationDeg(const Matrix6d& covariance);

/// Two sensors cannot stand in one place: it is one sensor under two names. `poses`: absent where a
/// sensor is not placed. One result a sensor: what to say of it, which names the last of its twins.
std::vector<std::optional<Finding>> FindTwins(const std::vector<std::string>& names,
                                              const std::vector<std::optional<Pose>>& poses,
                                              const VerdictOptions& options);

}  // namespace volalign
