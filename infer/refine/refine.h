#pragma once

#include <string>
#include <vector>

#include "core/config.h"
#include "core/pose.h"
#include "core/structure.h"
#include "infer/refine/refine_view.h"

namespace volalign {

/// What may be estimated beside the poses (design section 9; `--estimate`).
struct EstimateSet {
  bool boxes = false, size = false, depth_gain = false, depth_offset = false;
};
/// "auto" (all), "none", or a list of boxes, size, depth_gain, depth_offset, separated by commas.
/// Throws ConfigError for anything else.
EstimateSet ParseEstimate(const std::string& text);

struct RefineOptions {
  std::string estimate = "auto";
  double box_sigma_m = 0.004;
  double box_sigma_deg = 0.5;
  double size_sigma_percent = 1;
  double depth_gain_sigma_percent = 0.3;
  double depth_offset_sigma_m = 0.007;
  double edge_shift_sigma_px = 0.7;
  int outer_iterations = 5;
  int inner_iterations = 6;
  int fine_iterations = 3;
  int max_side_points = 3000;
  int max_edge_points = 600;
  int max_overlap_points = 700;
  double overlap_weight = 2;
  double min_overlap = 0.05;
  double edge_weight = 30;
  std::vector<std::string> without_structure;
  int threads = 2;
  /// Not a config key: false leaves all that is to be estimated free, whether the capture tells it
  /// or not, for callers that want a pose and its covariance alone.
  bool choose_estimates = true;
  /// Not a config key: false leaves the coarse stage out, for start poses that it has seen already.
  bool coarse = true;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("estimate", estimate,
       "what is estimated beside the poses, where the capture tells: auto, none, or a list of "
       "boxes, size, depth_gain, depth_offset (separated by commas)");
    ar("box_sigma_m", box_sigma_m,
       "prior standard deviation of a box's horizontal place along each axis, m", AtLeast(0));
    ar("box_sigma_deg", box_sigma_deg,
       "prior standard deviation of a box's turn about the vertical, deg", AtLeast(0));
    ar("size_sigma_percent", size_sigma_percent,
       "prior standard deviation of the size error that all boxes share, percent", AtLeast(0));
    ar("depth_gain_sigma_percent", depth_gain_sigma_percent,
       "prior standard deviation of a sensor's depth gain, percent", AtLeast(0));
    ar("depth_offset_sigma_m", depth_offset_sigma_m,
       "prior standard deviation, m, of a constant that a sensor's depth is off by (Azure Kinect: "
       "up to 11 mm)",
       AtLeast(0));
    ar("edge_shift_sigma_px", edge_shift_sigma_px,
       "prior standard deviation of the pixels by which a sensor widens silhouettes", AtLeast(0));
    ar("outer_iterations", outer_iterations,
       "coarse associations, each followed by a Ceres solution", AtLeast(1));
    ar("inner_iterations", inner_iterations, "most steps of a Ceres solution", AtLeast(1));
    ar("fine_iterations", fine_iterations,
       "associations of the last stage, which weighs errors as they are correlated", AtLeast(1));
    ar("max_side_points", max_side_points, "most labelled points of a sensor", AtLeast(100));
    ar("max_edge_points", max_edge_points, "most silhouette points of a sensor", AtLeast(0));
    ar("max_overlap_points", max_overlap_points,
       "most points of one sensor that are matched with another's; 0 leaves every sensor to itself",
       AtLeast(0));
    ar("overlap_weight", overlap_weight,
       "weight of overlap residuals beside those to the structure", AtLeast(0));
    ar("edge_weight", edge_weight,
       "weight of silhouette residuals: errors of neighbouring points on a face are alike, so that "
       "thousands of "
       "them say less than their number",
       AtLeast(0));
    ar("min_overlap", min_overlap,
       "least share of a sensor's points that another one sees, for the two to be a pair",
       Between(0, 1));
    ar("without_structure", without_structure,
       "sensors that are held by their neighbours' overlap alone");
    ar("threads", threads, "threads of Ceres", AtLeast(1));
  }
};

/// One sensor of the joint problem.
struct RefineSensor {
  const RefineView* view = nullptr;
  Pose initial = Pose::Identity();  ///< structure_from_sensor: what a refinement that is no better
                                    ///< falls back to
  Pose start = Pose::Identity();    ///< where the solution begins
  bool use_structure_terms = true;
};

struct RefinedSensor {
  Pose structure_from_sensor = Pose::Identity();
  bool accepted =
      false;  ///< false: held-out points are explained no better, the initial pose stands
  /// Mean square of held-out points' residuals in standard deviations, as errors are correlated; of
  /// a sensor without structure terms, mean robust cost against its neighbours.
  double held_out_before = 0, held_out_after = 0;
  /// Of delta = [translation; rotation vector] in T = Exp(delta) T^, structure frame; m, rad.
  Matrix6d covariance = Matrix6d::Zero();

  /// True depth = measured depth * depth_gain + depth_offset. 1 and 0 where not estimated; the
  /// sigmas are posterior ones in either case.
  double depth_offset = 0, depth_gain = 1;  ///< m, 1
  double sigma_depth_offset = 0, sigma_depth_gain = 0;
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

struct RefinedPair {
  int a = 0, b = 0;    ///< indices of the sensors, a < b
  double overlap = 0;  ///< share of the sampled points, of both, that the other one sees too
  double rms = 0;      ///< m, point to plane over them
};

struct RefineResult {
  std::vector<RefinedSensor> sensors;
  std::vector<RefinedPair> pairs;
  std::vector<RefinedBox> boxes;  ///< of Structure::boxes()
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;
  Structure built;  ///< the structure with the estimated placement and size
};

/// Directions in which a pose with this covariance (structure frame, m and rad) is open: each
/// eigenvector of its translation or rotation part with a standard deviation above 3 cm or 2 deg,
/// as "along structure x (0.12 m)" or "about the vertical (4.1 deg)".
std::vector<std::string> UnconstrainedDirections(const Matrix6d& covariance);

/// One Ceres problem over all sensors, in two stages.
///
/// Coarse, from far off: labelled points to the finite rectangles of their sides (infinite planes
/// would let a sensor that sees parallel sides slide), silhouettes to edge lines, and symmetric
/// point-to-plane terms between sensors that see the same surfaces, under Cauchy's loss.
/// Correspondences are renewed between solutions while distance and normal gates tighten.
///
/// Fine, as a statistical model (refine_model.h): the points of an image block on a side are one
/// measurement of depth, silhouettes measure bearing alone. Depth errors are a smooth random field
/// whose size and correlation length each sensor's residuals tell (restricted likelihood), plus a
/// constant, a scale, and an error in concave seams; silhouettes may be shifted outwards. Together
/// with each box's place and turn and the size of all boxes these are parameters with priors.
/// Between sensors, what both see off the structure is compared. A sensor without structure terms
/// is held by its overlap alone.
///
/// A parameter is estimated where its posterior is clearly tighter than its prior and held-out
/// points fit no better without its kind; else it keeps its nominal value. Gauge: the mean
/// displacement of the estimated boxes is zero. A sensor whose held-out points fit
/// its refined pose no better, neither in standard deviations nor by plain distance, keeps its
/// initial pose, and the others are solved again without it.
///
/// Covariance: of the posterior with everything free, H^-1; where options.estimate leaves something
/// out, widened by how far the poses would move if it did not, and for a sensor that keeps its
/// initial pose by how far the refused one was from it. A prior of 1 m and 1 rad bounds directions
/// that nothing constrains. Throws ConfigError for a bad options.estimate.
RefineResult Refine(const Structure& structure, const std::vector<RefineSensor>& sensors,
                    const RefineOptions& options);

}  // namespace volalign
