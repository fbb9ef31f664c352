#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/refine/options.h"
#include "infer/refine/problem.h"
#include "infer/refine/sensor_points.h"

namespace volalign {

/// What a frame that contradicts the others would have had to accept to fit to them.
struct RefusedFit {
  Pose structure_from_sensor = Pose::Identity();  ///< of the joint solution with it
  std::vector<int> contradicts;  ///< indices of the frames that show it, the clearest first
  Structure built;               ///< as the frame itself has it
};

/// Of a frame; poses in the structure of its still.
struct RefinedFrame {
  Pose structure_from_sensor = Pose::Identity();
  bool solved = false;  ///< false: its numbers failed, and it stays at FrameInput::start
  /// Of a frame that disagrees with the others. Its pose and depth errors are then those that its
  /// own measurements and the priors make most probable, and the others are solved without it; it
  /// counts as solved.
  std::optional<RefusedFit> refused_fit;
  /// Half the square, in standard deviations, of how far its own measurements are from what those
  /// of all other frames predict. Zero of a frame without structure terms.
  double disagreement = 0;
  /// A sentence where numbers failed; else empty. What is given is finite all the same.
  std::string problem;
  /// Of delta = [translation; rotation vector] in T = Exp(delta) T^, structure frame; m, rad.
  Matrix6d covariance = Matrix6d::Zero();
  /// The same in the structure of the first still.
  Pose first_from_sensor = Pose::Identity();
  Matrix6d first_covariance = Matrix6d::Zero();

  /// True depth = measured depth * depth_gain + depth_offset. 1 and 0 where not estimated; the
  /// sigmas are posterior ones in either case.
  double depth_offset = 0, depth_gain = 1;  ///< m, 1
  double sigma_depth_offset = 0, sigma_depth_gain = 0;
  /// Logarithm of its sensor's own factor on the focal length of its lens; 0 where not estimated.
  double own_focal = 0;
  refine_internal::NoiseModel noise;  ///< fitted, or FrameInput::noise
};

/// A box's displacement: it stands at T * structure_from_box, T a turn about the vertical through
/// its nominal centre and a horizontal shift.
struct RefinedBox {
  bool estimated = false;
  double x = 0, z = 0;              ///< m
  double yaw = 0;                   ///< rad
  double sigma_x = 0, sigma_z = 0;  ///< posterior, relative to the mean of all boxes
  double sigma_yaw = 0;
};

struct RefinedLens {
  LensChange change = LensChange::Zero();  ///< from the assumed intrinsics
  bool estimated = false;
  Eigen::Vector3d sigmas = Eigen::Vector3d::Zero();  ///< posterior
};

/// Two frames of one still.
struct RefinedPair {
  int a = 0, b = 0;    ///< indices of the frames, a < b
  double overlap = 0;  ///< share of the sampled points, of both, that the other one sees too
  /// m, point to plane over them: as they were measured, and as the errors of both depths, of the
  /// poses, depth offsets and gains let expect. NaN where the overlap does not tell.
  double rms = 0, predicted_rms = 0;
  /// Of delta of b less that of a, see RefinedFrame::covariance: what moves both alike is no part
  /// of it.
  Matrix6d covariance = Matrix6d::Zero();
};

/// Where the stack stood in a still, and how its boxes did.
struct RefinedPlacement {
  Pose first_from_placement = Pose::Identity();
  /// Of delta as of a pose's, m and rad, in the structure frame of the first still, which has none.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<RefinedBox> boxes;  ///< of Structure::boxes()
  Structure built;                ///< the structure with the boxes' places and the size
};

/// What is estimated of one quantity beside the poses, and what was known of it before.
struct RefinedQuantity {
  enum class Kind { kSize, kBoxX, kBoxZ, kBoxYaw, kDepthGain, kDepthOffset };
  Kind kind = Kind::kSize;
  int of = 0;                         ///< index of the frame or of the box; 0 of the size
  double value = 0;                   ///< less the prior's mean: 1, m or rad; 0 where it is held
  double prior_sigma = 0, sigma = 0;  ///< before and after
  /// By how many standard deviations what was measured is off the prior's mean. A value follows its
  /// prior: if that is true, its variance is the prior's less the posterior's.
  double Sigmas() const {
    const double freed = prior_sigma * prior_sigma - sigma * sigma;
    return freed > 0 ? std::abs(value) / std::sqrt(freed) : 0;
  }
};

/// A single box that is longer along one edge than described, all others being as described.
struct RefinedEdge {
  int box = 0, axis = 0;         ///< the axis is of the box's own frame
  double change = 0, sigma = 0;  ///< m
  double log_odds = 0;           ///< natural, against an error of size that all boxes share
};

struct RefineResult {
  std::vector<RefinedFrame> frames;  ///< of the frames that were given
  std::vector<RefinedPair> pairs;
  std::vector<RefinedPlacement> placements;  ///< of the stills, the first with the identity
  std::vector<RefinedLens> lenses;           ///< of those given
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;
  /// Of the size, of each box in each still, and of each sensor's depths.
  std::vector<RefinedQuantity> quantities;
  /// The likeliest, where a frame disagrees or a quantity is kClearly off its prior.
  std::optional<RefinedEdge> wrong_edge;
  /// Whether the last solution of all parameters ended by its tolerances, not by
  /// RefineSchedule::inner_iterations.
  bool converged = true;
};

/// Directions in which a pose with this covariance (structure frame, m and rad) is open: each
/// eigenvector of its translation or rotation part with a standard deviation above 3 cm or 2 deg,
/// as "along structure x (0.12 m)" or "about the vertical (4.1 deg)".
std::vector<std::string> UnconstrainedDirections(const Matrix6d& covariance);

/// Refines all frames together (refine/solution.h).
///
/// It is a statistical model: the points of an image block on a side are one measurement of
/// depth, silhouettes measure bearing alone. Depth errors are a smooth random field whose size and
/// correlation length each sensor's residuals tell (restricted likelihood), plus a constant, a
/// gain, and an error in concave seams; silhouettes may be shifted outwards. Together with each
/// box's place and turn and the size of all boxes these are parameters with priors. Between
/// sensors, what both see off the structure is compared. A sensor without structure terms is held
/// by its overlap alone. Sensors whose FrameInput::lens is an index into `lenses` look through
/// that lens, whose change from SensorLens::change is a parameter, too, with the evidence that
/// large planes give; sensors may share one.
///
/// Several stills of the same sensors have the stack in several places. `placements`, one per
/// still, are about first_from_placement, the first the identity. Each is a parameter, as are the
/// boxes of each still; a sensor's depth gain, its lens and the size are the same in all. The
/// frames of a sensor (FrameInput::sensor) have a pose each, which differ by the placements and by
/// as little as PriorOptions::sensor_moved_sigma_m and _deg allow.
///
/// How far the parameters of each kind stray from their nominal values is estimated, too: their
/// priors are as much narrower as makes the measurements most probable (refine/prior_scales.h).
/// Gauge: the mean displacement of the boxes is zero.
///
/// Covariance: of the posterior with everything free; where EstimateSet does not ask for all of it,
/// widened by how far the poses would move if it did. A prior of 1 m and 1 rad bounds directions
/// that nothing constrains. Throws DataError for a start that is not finite.
RefineResult Refine(const Structure& structure, const std::vector<FrameInput>& frames,
                    const RefineSetup& setup, const std::vector<SensorLens>& lenses = {},
                    const std::vector<Pose>& placements = {Pose::Identity()});

}  // namespace volalign
