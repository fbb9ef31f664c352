#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/refine/noise_model.h"
#include "infer/refine/options.h"
#include "infer/refine/problem.h"
#include "infer/refine/sensor_points.h"

namespace volalign {

/// The fit that an excluded frame would have in the joint solution.
struct RefusedFit {
  Pose structure_from_sensor = Pose::Identity();  ///< in the joint solution with the frame
  bool disagrees = true;         ///< false: unusual, and its sensor has another frame
  std::vector<int> contradicts;  ///< indices of the frames that show it, the clearest first
  Structure built;               ///< as the frame itself has it
};

/// A refined frame. Poses are in the structure of its capture.
struct RefinedFrame {
  Pose structure_from_sensor = Pose::Identity();
  bool solved = false;  ///< false: numbers failed; it stays at FrameInput::start
  /// Set if the frame disagrees with the others. Its pose and depth errors are then the most
  /// probable ones by its own measurements and the priors. The others are solved without it. It
  /// counts as solved.
  std::optional<RefusedFit> refused_fit;
  /// How far its own measurements are from the prediction by all other frames: half the square, in
  /// standard deviations. Zero if the frame has no structure terms.
  double disagreement = 0;
  /// A sentence if numbers failed, else empty. All values are finite even then.
  std::string problem;
  /// Covariance of delta = [translation; rotation vector] in T = Exp(delta) T^, structure frame, m
  /// and rad.
  Matrix6d covariance = Matrix6d::Zero();
  /// The pose and covariance in the structure of the first capture.
  Pose first_from_sensor = Pose::Identity();
  Matrix6d first_covariance = Matrix6d::Zero();

  /// True depth = measured depth * depth_gain + depth_offset. 1 and 0 if not estimated; the sigmas
  /// are posterior ones in either case.
  double depth_offset = 0, depth_gain = 1;  ///< m, 1
  double sigma_depth_offset = 0, sigma_depth_gain = 0;
  /// Logarithm of its sensor's own factor on the focal length of its lens; 0 if not estimated.
  double own_focal = 0;
  refine_internal::NoiseModel noise;  ///< as fitted
};

/// A box's displacement: it stands at T * structure_from_box. T is a turn about the vertical
/// through its nominal centre and a horizontal shift.
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

/// Two frames of one capture.
struct RefinedPair {
  int a = 0, b = 0;    ///< indices of the frames, a < b
  double overlap = 0;  ///< share of the sampled points of both that the other one sees
  /// m, point to plane over these points: measured, and as expected from the errors of both depths,
  /// poses, depth offsets and gains. NaN if the overlap says nothing.
  double rms = 0, predicted_rms = 0;
  /// Covariance of b's delta less a's (see RefinedFrame::covariance). Common movement cancels.
  Matrix6d covariance = Matrix6d::Zero();
};

/// The places of the stack and its boxes in a capture.
struct RefinedPlacement {
  Pose first_from_placement = Pose::Identity();
  /// Covariance of delta as of a pose, m and rad, in the structure frame of the first capture,
  /// which has none.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<RefinedBox> boxes;  ///< of Structure::boxes()
  Structure built;                ///< the structure with the boxes' places and the size
};

/// An estimate of one quantity beside the poses, with its prior.
struct RefinedQuantity {
  enum class Kind { kSize, kBoxX, kBoxZ, kBoxYaw, kDepthGain, kDepthOffset };
  Kind kind = Kind::kSize;
  int of = 0;                         ///< index of the frame or of the box; 0 of the size
  double value = 0;                   ///< less the prior's mean: 1, m or rad; 0 if fixed
  double prior_sigma = 0, sigma = 0;  ///< before and after
  /// Distance of the measurement from the prior's mean, in standard deviations. The variance of
  /// `value` under a true prior is the prior's variance less the posterior's.
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

/// The size that all boxes share.
struct RefinedSize {
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;
};

struct RefineResult : RefinedSize {
  std::vector<RefinedFrame> frames;  ///< in the order of the input
  std::vector<RefinedPair> pairs;
  std::vector<RefinedPlacement> placements;  ///< of the captures; the first: identity
  std::vector<RefinedLens> lenses;           ///< of those given
  /// Where the world of the priors (FrameInput::prior) lies in the structure of the first capture.
  Pose structure_from_world = Pose::Identity();
  double world_scale = 1;
  /// Those of the size, of each box in each capture, and of each sensor's depths.
  std::vector<RefinedQuantity> quantities;
  /// The likeliest one, if a frame disagrees or a quantity is kClearly off its prior.
  std::optional<RefinedEdge> wrong_edge;
  /// Did the last solution of all parameters end by its tolerances, not by
  /// RefineOptions::inner_iterations?
  bool converged = true;
};

/// Directions in which a pose with this covariance (structure frame, m and rad) is open. They are
/// eigenvectors of its translation or rotation part with a standard deviation above 3 cm or 2 deg.
/// Written as "along structure x (0.12 m)" or "about the vertical (4.1 deg)".
std::vector<std::string> UnconstrainedDirections(const Matrix6d& covariance);

/// Refines all frames together by a statistical model (refine/solution.h).
///
/// Observations: the points of an image block on a side are one measurement of depth. Silhouettes
/// measure bearing alone. Between sensors, overlap off the structure is compared. A sensor without
/// structure terms depends on its overlap alone.
///
/// Depth errors: a smooth random field, a constant, a gain, and an error in concave seams. Each
/// sensor's residuals determine the field's size and correlation length (restricted likelihood).
/// Silhouettes may be shifted outwards. These, each box's place and turn, and the size of all boxes
/// are parameters with priors.
///
/// Lenses: FrameInput::lens is an index into `lenses`; sensors may share one. A lens's change from
/// SensorLens::change is a parameter, too, with the evidence of large planes.
///
/// Several captures of the same sensors have the stack in several places. `placements`, one per
/// capture, are approximate first_from_placement, the first the identity. Each is a parameter, as
/// are the boxes of each capture. A sensor's depth gain, its lens and the size are the same in all.
/// Each frame of a sensor (FrameInput::sensor) has its own pose. These poses differ by the
/// placements and by as little as RefineOptions::sensor_moved_sigma_m and _deg allow.
///
/// Priors: each kind of parameter has its prior narrowed until the measurements are most probable
/// (refine/prior_scales.h). Gauge: the mean displacement of the boxes is zero.
///
/// Covariance: the posterior's with everything free. If EstimateSet does not ask for all, it is
/// widened by how far the poses would move otherwise. A prior of 1 m and 1 rad bounds directions
/// that nothing constrains. Throws DataError for a start that is not finite.
RefineResult Refine(const Structure& structure, const std::vector<FrameInput>& frames,
                    const RefineSetup& setup,
                    const std::vector<SensorLens>& lenses = {SensorLens()},
                    const std::vector<Pose>& placements = {Pose::Identity()});

/// The version of the Ceres that this library was built with, and its build options:
/// "2.1.0-eigen-...".
std::string CeresVersion();

}  // namespace volalign
