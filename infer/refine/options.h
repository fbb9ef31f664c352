#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "infer/view/alike.h"

namespace volalign {

/// The parameters that may be estimated beside the poses (`refine.estimate`).
struct EstimateSet {
  bool boxes = false, size = false, depth_gain = false, depth_offset = false, lens = false;
  /// False: priors stay as wide as in the options, and no frame is excluded. For callers that want
  /// a pose and its covariance alone.
  bool scale_priors = true;
};
/// Reads "auto" (all), "none", or a list of boxes, size, depth_gain, depth_offset, lens, separated
/// by commas. Throws ConfigError for anything else.
EstimateSet ParseEstimate(const std::string& text);

/// The keys of the configuration, and figures that are no keys.
struct RefineOptions {
  // Standard deviations of the priors.
  double box_sigma_m = 0.004;
  double box_sigma_deg = 0.5;
  double size_sigma_percent = 1;
  /// How far a side bulges in its middle. Sides of real cardboard boxes deviate by 2 to 4 mm from a
  /// plane, part of which is the sensor's error.
  double bulge_sigma_m = 0.002;
  double depth_gain_sigma_percent = -1;
  double depth_offset_sigma_m = 0.007;
  double edge_shift_sigma_px = 0.7;  ///< by how much a sensor widens silhouettes
  double sensor_moved_sigma_m = 2e-4;
  double sensor_moved_sigma_deg = 0.005;
  double depth_drift_sigma_m = 0.002;  ///< of a depth offset between captures (warmth)

  // The rounds of a refinement, and their limits.
  int inner_iterations = 12;   ///< most steps of a Ceres solution
  int associations = kRounds;  ///< of points with surfaces, each followed by a Ceres solution
  int max_overlap_points = 4000;
  /// Two sensors are a pair if at least this share of their points is seen by the other one.
  double min_overlap = kNotable;
  int threads = 2;  ///< of Ceres

  std::string estimate = "auto";
  bool lens_per_sensor = false;
  int max_side_points = 3750;  ///< most labelled points of a sensor
  int max_edge_points = 600;   ///< most silhouette points of a sensor

  template <class Archive>
  void Describe(Archive& ar) {
    ar("estimate", estimate,
       "quantities to estimate besides the poses: auto (all of the list), none, or a list of "
       "boxes, size, depth_gain, depth_offset, lens (separated by commas)");
    ar("lens_per_sensor", lens_per_sensor,
       "true: each sensor has a lens of its own. false: sensors of one kind share a lens, except "
       "for a small deviation of the focal length");
    ar("box_sigma_m", box_sigma_m,
       "prior standard deviation of a box's horizontal place along each axis, m", AtLeast(0));
    ar("box_sigma_deg", box_sigma_deg,
       "prior standard deviation of a box's turn about the vertical, deg", AtLeast(0));
    ar("size_sigma_percent", size_sigma_percent,
       "prior standard deviation of the size error that all boxes share, percent", AtLeast(0));
    ar("depth_gain_sigma_percent", depth_gain_sigma_percent,
       "prior standard deviation of every sensor's depth gain, percent; -1: that of its kind "
       "(unit_gain of configs/intrinsics.yaml)",
       Between(-1, 100));
    ar("depth_offset_sigma_m", depth_offset_sigma_m,
       "prior standard deviation of a constant error of a sensor's depth, m (Azure Kinect: up to "
       "11 mm)",
       AtLeast(0));
    ar("sensor_moved_sigma_m", sensor_moved_sigma_m,
       "prior standard deviation of a sensor's movement between two captures, m (floors give way, "
       "and tripods creep)",
       Above(0));
    ar("sensor_moved_sigma_deg", sensor_moved_sigma_deg,
       "prior standard deviation of a sensor's rotation between two captures, deg", Above(0));
    ar("max_overlap_points", max_overlap_points,
       "largest number of matches of one sensor's points with those of the others, shared equally "
       "among them; 0: each sensor by itself",
       AtLeast(0),
       Removed("without_structure",
               "a sensor is placed by its own view of the structure, and overlap counts beside it",
               std::vector<std::string>{}),
       Fixed("bulge_sigma_m", 0.002), Fixed("edge_shift_sigma_px", 0.7),
       Fixed("depth_drift_sigma_m", 0.002), Fixed("inner_iterations", 12), Fixed("associations", 3),
       Fixed("fine_iterations", 3), Fixed("max_edge_points", 600), Fixed("min_overlap", 0.05),
       Removed("max_side_points", "it is 3750 now; leave the key out",
               std::vector<std::string>{"3000"}),
       Removed("threads", "threads of the calibration are those of Ceres, too; leave the key out",
               std::vector<std::string>{"2"}));
  }
};

struct RefineResult;

/// A refinement: its options, and what is free.
struct RefineSetup : RefineOptions {
  RefineSetup() : RefineSetup(RefineOptions()) {}
  /// Takes the configuration. Throws ConfigError for a bad `estimate`.
  RefineSetup(const RefineOptions& options)  // NOLINT(google-explicit-constructor)
      : RefineOptions(options), free(ParseEstimate(options.estimate)) {}

  EstimateSet free;
  /// Are covariances, sigmas and pairs wanted for this result, which has none yet? Empty: they are.
  /// For callers that go on from some poses and need none.
  std::function<bool(const RefineResult&)> is_final;
};

}  // namespace volalign
