#include "infer/lens/straightness.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/lists.h"
#include "core/geometry/factor.h"
#include "infer/lens/likelihood.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

using refine_internal::FitSmoothError;
using refine_internal::SmoothMovement;

/// Largest mean square of a plane's residuals, in standard deviations.
constexpr double kNoPlane = 2;

// The search for the lens.
/// Least gain in half the sum of squares for another step, and least part of a whole step.
constexpr double kLeastGain = 1e-3;

/// A plane's residuals, m, and their derivatives.
struct PlaneResiduals {
  Eigen::VectorXd residuals;  // distances from the plane that fits best
  Eigen::MatrixXd by_plane;   // columns: two turns and a shift
  Eigen::MatrixXd by_lens;
  SmoothMovement movement;
};

/// Residuals of points that were seen through a lens of these intrinsics.
PlaneResiduals ResidualsOf(const std::vector<Eigen::Vector3d>& points, const Intrinsics& intrinsics,
                           const DepthErrorModel& errors) {
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p;
  mean /= static_cast<double>(n);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) covariance += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  const Eigen::Vector3d normal = solver.eigenvectors().col(0);

  PlaneResiduals of{Eigen::VectorXd(n),
                    Eigen::MatrixXd(n, 3),
                    Eigen::MatrixXd(n, kLensParameters),
                    {Eigen::MatrixX2d(n, 2), Eigen::VectorXd(n)}};
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d& p = points[static_cast<std::size_t>(i)];
    const Eigen::Vector3d d = p - mean;
    const Eigen::Vector2d ray = p.head<2>() / p.z();
    of.residuals[i] = normal.dot(d);
    of.by_plane.row(i) << solver.eigenvectors().col(1).dot(d), solver.eigenvectors().col(2).dot(d),
        1;
    of.by_lens.row(i) = p.z() * normal.head<2>().transpose() * RayByLens(intrinsics, ray);
    // A plane stays one if all rays are scaled. With distortion, the focal length has a small
    // influence left, but k1 and k2 describe nearly the same change of the curve.
    of.by_lens(i, 0) = 0;
    of.movement.levers[i] = SmoothMovement::Lever(errors, p, normal);
    of.movement.bearings.row(i) = ray;
  }
  return of;
}

/// Covariance of the errors, with the smooth error under which the residuals are most probable.
/// `variances`: of the independent errors.
Eigen::MatrixXd FitCovariance(const PlaneResiduals& plane, const Eigen::VectorXd& variances,
                              DepthErrorModel errors) {
  Eigen::MatrixXd unknown(plane.residuals.size(), 3 + kLensParameters);
  unknown << plane.by_plane, plane.by_lens;
  const Eigen::MatrixXd own = variances.asDiagonal();
  FitSmoothError(plane.movement, own, plane.residuals, unknown, &errors);
  return errors.smooth_m * errors.smooth_m * plane.movement.Covariance(errors.smooth_rad) + own;
}

/// Residuals and their derivatives by the lens, in standard deviations. They are independent of
/// each other and of the plane's own place.
struct Whitened {
  Eigen::VectorXd residuals;
  Eigen::MatrixXd by_lens;
};

Whitened Whiten(const PlaneResiduals& plane, const Eigen::MatrixXd& root) {
  Eigen::MatrixXd all(plane.residuals.size(), 4 + kLensParameters);
  all << plane.by_plane, plane.by_lens, plane.residuals;
  root.triangularView<Eigen::Lower>().solveInPlace(all);
  const Eigen::HouseholderQR<Eigen::MatrixXd> of_plane(all.leftCols<3>());
  const Eigen::MatrixXd rest =
      (of_plane.householderQ().transpose() * all.rightCols(1 + kLensParameters))
          .bottomRows(all.rows() - 3);
  return {rest.rightCols<1>(), rest.leftCols<kLensParameters>()};
}

double PriorCost(const LensChange& change, const Eigen::Vector3d& sigmas) {
  double cost = 0;
  for (int k = 0; k < kLensParameters; ++k) {
    if (change[k] != 0) cost += 0.5 * change[k] * change[k] / (sigmas[k] * sigmas[k]);
  }
  return cost;
}

}  // namespace

/// So few patches have no shape.
constexpr std::size_t kPlaneParameters = 3;

/// A plane with its errors.
class WeighedPlane {
 public:
  WeighedPlane(const LargePlane& plane, const Intrinsics& seen_with, const DepthErrorModel& errors)
      : patches_(EvenSubset(plane.patches, kFewProbes)), seen_with_(seen_with), errors_(errors) {
    if (patches_.size() <= kPlaneParameters) return;
    const PlaneResiduals at = ResidualsOf(PointsThrough(seen_with), seen_with, errors);
    Eigen::VectorXd variances(at.residuals.size());
    for (std::size_t i = 0; i < patches_.size(); ++i)
      variances[static_cast<Eigen::Index>(i)] = patches_[i].variance + kDepthStep * kDepthStep;
    const auto factor = refine_internal::Factor(FitCovariance(at, variances, errors));
    if (!factor) return;
    root_ = factor->matrixL();
    const Whitened white = Whiten(at, root_);
    const Eigen::VectorXd left =
        white.residuals -
        white.by_lens * white.by_lens.colPivHouseholderQr().solve(white.residuals);
    flat_ = left.squaredNorm() < kNoPlane * static_cast<double>(left.size());
  }

  /// Does some lens make it flat?
  bool flat() const { return flat_; }

  Whitened Through(const Intrinsics& intrinsics) const {
    return Whiten(ResidualsOf(PointsThrough(intrinsics), intrinsics, errors_), root_);
  }

 private:
  std::vector<Eigen::Vector3d> PointsThrough(const Intrinsics& intrinsics) const {
    std::vector<Eigen::Vector3d> points;
    for (const PlanePatch& patch : patches_) {
      const Eigen::Vector2d ray =
          SamePixelRay(seen_with_, intrinsics, patch.p.head<2>() / patch.p.z());
      points.emplace_back(patch.p.z() * ray.homogeneous());
    }
    return points;
  }

  std::vector<PlanePatch> patches_;
  Intrinsics seen_with_;
  DepthErrorModel errors_;
  Eigen::MatrixXd root_;
  bool flat_ = false;
};

namespace {

/// Half the sum of squares of all sensors' residuals at a change. `evidence`: theirs about the
/// lens.
double CostAt(const std::vector<std::vector<WeighedPlane>>& sensors,
              const std::vector<Intrinsics>& assumed, const LensChange& change,
              LensEvidence* evidence) {
  *evidence = LensEvidence();
  double cost = 0;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    const Intrinsics intrinsics = WithLensChange(assumed[i], change);
    double of_sensor = 0;
    for (const WeighedPlane& plane : sensors[i]) {
      const Whitened white = plane.Through(intrinsics);
      of_sensor += 0.5 * white.residuals.squaredNorm();
      evidence->information += white.by_lens.transpose() * white.by_lens;
      evidence->moment -= white.by_lens.transpose() * white.residuals;
    }
    cost += of_sensor;
  }
  evidence->moment += evidence->information * change;
  return cost;
}

}  // namespace

Straightness::Straightness(const std::vector<SensorPlanes>& sensors) {
  for (const SensorPlanes& sensor : sensors) {
    std::vector<WeighedPlane>& planes = sensors_.emplace_back();
    for (const LargePlane& plane : sensor.planes) {
      WeighedPlane weighed(plane, sensor.intrinsics, sensor.errors);
      if (weighed.flat()) planes.push_back(std::move(weighed));
    }
  }
}
Straightness::~Straightness() = default;

LensEstimate Straightness::Straighten(const std::vector<Intrinsics>& assumed,
                                      const Eigen::Vector3d& prior_sigmas,
                                      const LensChange& start) const {
  LensChange change = start;
  LensEvidence evidence;
  const auto evaluate = [&](const LensChange& at, LensEvidence* of) {
    return CostAt(sensors_, assumed, at, of) + PriorCost(at, prior_sigmas);
  };
  double cost = evaluate(change, &evidence);
  for (bool better = true; better;) {
    const LensChange full = EstimateLens(evidence, prior_sigmas).change - change;
    better = false;
    for (double share = 1; share > kLeastGain; share /= 2) {
      LensEvidence there;
      const double cost_there = evaluate(change + share * full, &there);
      if (!(cost_there < cost)) continue;
      better = cost - cost_there > kLeastGain;
      change += share * full;
      cost = cost_there;
      evidence = there;
      break;
    }
  }
  LensEstimate estimate = EstimateLens(evidence, prior_sigmas);
  estimate.change = change;
  estimate.log_evidence = -cost;
  if (prior_sigmas.minCoeff() > 0) {
    const Eigen::Matrix3d inverse = prior_sigmas.cwiseInverse().asDiagonal();
    estimate.log_evidence +=
        0.5 * std::log((inverse * estimate.covariance * inverse).determinant());
  }
  return estimate;
}

LensEvidence Straightness::EvidenceAt(const std::vector<Intrinsics>& assumed,
                                      const LensChange& change) const {
  LensEvidence evidence;
  CostAt(sensors_, assumed, change, &evidence);
  return evidence;
}

double LargestBend(const SensorPlanes& sensor, const LensChange& change) {
  double largest = 0;
  for (const LargePlane& plane : sensor.planes) {
    if (plane.patches.size() <= kPlaneParameters) continue;
    std::vector<Eigen::Vector3d> points;
    for (const PlanePatch& patch : EvenSubset(plane.patches, kFewProbes)) points.push_back(patch.p);
    const PlaneResiduals of = ResidualsOf(points, sensor.intrinsics, sensor.errors);
    const Eigen::VectorXd moved = of.by_lens * change;
    const Eigen::VectorXd bent =
        moved - of.by_plane * of.by_plane.colPivHouseholderQr().solve(moved);
    largest = std::max(largest, bent.cwiseAbs().maxCoeff());
  }
  return largest;
}

}  // namespace volalign
