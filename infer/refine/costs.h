#pragma once

// Terms of the joint refinement over single points, and priors. Not for callers of Refine.

#include <ceres/cost_function.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/lens/sensor_lens.h"
#include "infer/refine/parameters.h"
#include "infer/refine/pose_block.h"
#include "infer/view/pose_prior.h"

namespace volalign::refine_internal {

/// Distance of point p of sensor a from the plane at q that sensor b measured, times `weight`:
/// weight * n . (T_b^-1 T_a p - q). parameters[0] and [1] are the poses of a and b. `jacobians`,
/// and each of its two, may be null.
double PointToPlane(const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Eigen::Vector3d& n,
                    double weight, double const* const* parameters, double** jacobians);

/// A point and the lens that it was seen through.
struct LensPoint {
  Eigen::Vector3d p;
  RayByLensMatrix by_lens;
  LensChange lens;                                          ///< with which p was measured
  SensorErrorVector by_errors = SensorErrorVector::Zero();  ///< see FaceObservation

  /// The point through a lens with this change and the sensor's own focal length (see State).
  Eigen::Vector3d Through(const double* change, double focal) const {
    Eigen::Vector3d moved = p;
    moved.head<2>() += p.z() * by_lens *
                       (Eigen::Map<const LensChange>(change) - lens + focal * LensChange::UnitX());
    return moved;
  }
};

/// A value and its derivative.
struct RobustResidual {
  double value, slope;
};
/// A robust version of a residual r in standard deviations. Its square is `share` times Cauchy's
/// loss of r^2, which bends at two.
RobustResidual MakeRobust(double residual, double share);

/// A point and a plane (PointToPlane), as they were measured.
struct MeasuredMatch {
  LensPoint a, b;
  Eigen::Vector3d n_b;
  double weight;
};

/// MakeRobust of the distances of points from planes. The distances are as the sensors' own errors
/// have them, divided by the mean of the gains (see Residuals). `share`: matches say less than as
/// many independent ones. Parameters: the poses of a and b, their depth offsets, the errors of
/// their sensors, and their lenses, a single one if `shared`. Normals stay as they were measured.
class MeasuredOverlapCost : public ceres::CostFunction {
 public:
  MeasuredOverlapCost(std::vector<MeasuredMatch> matches, double share, bool shared);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  /// One match, not made robust. `jacobians`, and each of them, may be null.
  void EvaluateMatch(const MeasuredMatch& match, double const* const* parameters, double* residual,
                     double** jacobians) const;

  std::vector<MeasuredMatch> matches_;
  double share_;
  bool shared_;
};

/// The -log-likelihood of a lens change is 0.5 |residuals|^2, up to a constant.
ceres::CostFunction* LensEvidenceCost(const LensEvidence& evidence);

/// A loose prior on the pose: [(T p0 - T0 p0) / sigma_t; 2 vec(q q0^-1) / sigma_r]. T0 takes the
/// sensor's point p0 to the structure's origin. The prior decides only directions that no
/// measurement constrains, and bounds their variance.
ceres::CostFunction* PosePriorCost(const Pose& prior, double sigma_translation,
                                   double sigma_rotation);

/// The difference of a sensor's pose from its prior: [t - W p; 2 vec(q q_p^-1)], divided by
/// standard deviations. W moves and scales the prior's position p and turns its rotation q_p.
/// Parameters: the motion of W and the logarithm of its scale, as far as PosePrior::world leaves
/// them open; the placement P and the pose T. t and q are of P T.
ceres::CostFunction* KnownPoseCost(const PosePrior& prior);

/// The change of a sensor's pose between two captures: [t_b - t_a; 2 vec(q_b q_a^-1)] of the poses
/// P_a T_a and P_b T_b. It is divided by standard deviations, m and rad. Parameters: P_a, T_a, P_b,
/// T_b.
ceres::CostFunction* TieCost(double sigma_translation, double sigma_rotation);

/// (b - a) / sigma, of two parameters of one element.
ceres::CostFunction* DriftCost(double sigma);

/// parameters / sigma, element by element.
ceres::CostFunction* PriorCost(const Eigen::VectorXd& sigmas);

}  // namespace volalign::refine_internal
