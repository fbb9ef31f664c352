#pragma once

// The statistical model of the joint refinement's last stage, apart from the problem so that tests
// can differentiate it. Not for callers.

#include <ceres/cost_function.h>

#include <Eigen/Core>
#include <string>
#include <vector>

#include "core/pose.h"
#include "core/structure.h"

namespace volalign::refine_internal {

/// One image block's points on one side, as one measurement. Sensor frame, m.
struct FaceObservation {
  Eigen::Vector3d p;  ///< mean of the points
  int label = 0;
  double multipath = 0;  ///< 1 in a concave seam, falling to 0 at kMultipathReach
  double variance = 0;   ///< m^2, along the side's normal, of the mean of independent point errors
};

/// Silhouette points of one image block along one edge of a side. Only their bearing counts.
struct EdgeObservation {
  Eigen::Vector3d p;
  int label = 0;
  int edge = 0;         ///< 0 ... 3: +u, -u, +v, -v of the side
  int axis = 0;         ///< see EdgePoint
  double pixel = 0;     ///< m across the edge, in the side's plane, that one pixel covers
  double variance = 0;  ///< px^2, independent of the other observations'
};

inline constexpr double kMultipathReach = 0.3;  // m, facts/sensors.md section 1

/// Errors that a sensor's observations share, beyond its constant depth error.
struct NoiseModel {
  double warp = 0.003;        ///< m at 2 m, standard deviation of the smooth depth error
  double warp_length = 0.15;  ///< rad: its correlation falls to 1/e or so
  double multipath = 0.02;    ///< m, standard deviation of the depth error in a concave seam
  double edge = 1;            ///< scale of the silhouettes' standard deviations
  double line = 0;  ///< m, standard deviation of an edge's place where its box's is not estimated
};

struct SensorEvidence {
  std::vector<FaceObservation> faces;
  std::vector<EdgeObservation> edges;
  NoiseModel noise;
  /// Lower Cholesky factors of the covariances, faces in m^2, edges in m^2.
  Eigen::MatrixXd face_root, edge_root;
};

/// Parameters of the structure's real build, one Ceres block: size scale - 1, then of each box its
/// x, z (m) and yaw (rad, about the vertical through its centre). Box b of the scaled stack stands
/// on the same floor: its centre rises by (size scale - 1) * (its height above the floor).
class BuildModel {
 public:
  explicit BuildModel(const Structure& structure)
      : structure_(&structure), floor_(structure.FloorHeight()) {}
  const Structure& structure() const { return *structure_; }
  double floor() const { return floor_; }
  int size() const { return 1 + 3 * static_cast<int>(structure_->boxes().size()); }
  static int X(int box) { return 1 + 3 * box; }
  static int Z(int box) { return 2 + 3 * box; }
  static int Yaw(int box) { return 3 + 3 * box; }
  /// Where the box went: structure_from_box' = Offset * structure_from_box (before scaling).
  Pose Offset(const double* build, int box) const;
  /// structure() as built.
  Structure Built(const double* build) const;

 private:
  const Structure* structure_;
  double floor_;
};

/// A sensor's parameter blocks in the order of SensorCost: pose (7), depth offset (1), nuisance (4:
/// depth gain - 1, multipath in m, outward shift in px of silhouettes along image rows and along
/// columns: a stereo matcher widens them along its baseline), build.
inline constexpr int kNuisances = 4;
inline constexpr int kDepthGain = 0, kMultipath = 1, kEdgeShift = 2;
struct SensorParameters {
  const double* pose;
  const double* offset;
  const double* nuisance;
  const double* build;
};

/// Signed distances, m: faces (to the infinite plane of the side as built), then edges (bearing
/// against the edge, measured in the side's plane). True depth = measured * (scale) + offset -
/// multipath * seam share. `jacobian`, if wanted: columns pose 7, offset, nuisances, build.
void Residuals(const BuildModel& model, const SensorEvidence& evidence,
               const SensorParameters& parameters, Eigen::VectorXd* residuals,
               Eigen::MatrixXd* jacobian);

/// Share of the multipath error that a point at q on the side of this label takes: concave seams
/// are where another box, or the floor, rises in front of the side.
double SeamShare(const Structure& structure, const Side& side, const Eigen::Vector3d& q);

/// Fills the Cholesky factors from evidence.noise. `pose`: where the observations are seen from.
void SetCovariance(const BuildModel& model, const Pose& pose, SensorEvidence* evidence);

/// Prior standard deviations of everything but the poses.
struct Priors {
  double offset = 0, gain = 0, edge_shift = 0, size = 0, box = 0, yaw = 0;
};

/// The noise model under which the residuals are most probable, the pose being unknown (restricted
/// maximum likelihood: Patterson and Thompson 1971) and the rest as its prior has it. Fills the
/// factors too.
void FitNoise(const BuildModel& model, const SensorParameters& parameters, const Priors& priors,
              SensorEvidence* evidence);

/// All residuals of a sensor, whitened by their joint covariance.
class SensorCost : public ceres::CostFunction {
 public:
  SensorCost(const BuildModel& model, const SensorEvidence& evidence);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const BuildModel& model_;
  const SensorEvidence& evidence_;
};

/// parameters / sigma, element by element.
class PriorCost : public ceres::CostFunction {
 public:
  explicit PriorCost(std::vector<double> sigmas);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  std::vector<double> sigmas_;
};

}  // namespace volalign::refine_internal
