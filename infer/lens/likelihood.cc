#include "infer/lens/likelihood.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/geometry/factor.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

/// Below the effect of an error of a pixel or less across the ray.
constexpr double kLeastLever = 0.2;
/// Spread of the logarithm of smooth_m. Real sensors of a kind lie within a factor of 2 or so
/// (docs/sensor-models.md).
constexpr double kSmoothSpread = 0.8;
const double kLeastSmooth = StepSigma() * kDepthStep, kMostSmooth = kSamePlace;  // m
constexpr std::array<double, 3> kSmoothLengths = {0.05, 0.1, 0.18};              // rad
const double kSmoothStep = std::cbrt(2);  // between sizes; a frame determines them to a tenth

}  // namespace

double RestrictedCost(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& r,
                      const Eigen::MatrixXd& jacobian) {
  const std::optional<CholeskyFactor> root = Factor(covariance);
  if (!root) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd y = root->matrixL().solve(r);
  const Eigen::MatrixXd a = root->matrixL().solve(jacobian);
  Eigen::MatrixXd information = a.transpose() * a;
  information.diagonal().array() += 1e-3;
  const std::optional<CholeskyFactor> inner = Factor(information);
  if (!inner) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd projected = inner->matrixL().solve(a.transpose() * y);
  return LogRoot(*root) + LogRoot(*inner) + 0.5 * (y.squaredNorm() - projected.squaredNorm());
}

double SmoothMovement::Lever(const DepthErrorModel& errors, const Eigen::Vector3d& p,
                             const Eigen::Vector3d& normal) {
  return std::hypot(normal.dot(p) / p.z(), kLeastLever) * errors.SmoothGrowth(p.z());
}

Eigen::MatrixXd SmoothMovement::Covariance(double length_rad) const {
  const Eigen::Index n = levers.size();
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      covariance(i, j) = covariance(j, i) =
          levers[i] * levers[j] *
          Correlation((bearings.row(i) - bearings.row(j)).norm(), length_rad);
    }
  }
  return covariance;
}

void FitSmoothError(const SmoothMovement& movement, const Eigen::MatrixXd& rest,
                    const Eigen::VectorXd& residuals, const Eigen::MatrixXd& unknown,
                    DepthErrorModel* errors) {
  struct Candidate {
    double smooth, length, cost;
  };
  std::vector<Candidate> candidates;
  double least = std::numeric_limits<double>::infinity();
  for (const double length : kSmoothLengths) {
    const Eigen::MatrixXd unit = movement.Covariance(length);
    for (double smooth = kLeastSmooth; smooth < kMostSmooth; smooth *= kSmoothStep) {
      const double unusual = std::log(smooth / errors->smooth_m) / kSmoothSpread;
      const double cost = RestrictedCost(smooth * smooth * unit + rest, residuals, unknown) +
                          0.5 * unusual * unusual;
      candidates.push_back({smooth, length, cost});
      if (cost < least) least = cost;
    }
  }
  if (!std::isfinite(least)) return;
  double weights = 0, squares = 0, lengths = 0;
  for (const Candidate& candidate : candidates) {
    const double weight = std::exp(least - candidate.cost);
    if (!(weight > 0)) continue;  // nor NaN
    weights += weight;
    squares += weight * candidate.smooth * candidate.smooth;
    lengths += weight * candidate.length;
  }
  errors->smooth_m = std::sqrt(squares / weights);
  errors->smooth_rad = lengths / weights;
}

}  // namespace volalign::refine_internal
