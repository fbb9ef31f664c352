#pragma once

// Likelihoods of residuals whose errors are correlated. Not for callers of Refine.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/depth_error_model.h"

namespace volalign::refine_internal {

/// Matern 3/2: a smooth field, but not so smooth that it could be predicted far away.
inline double Correlation(double distance, double length) {
  const double x = std::sqrt(3) * distance / length;
  return (1 + x) * std::exp(-x);
}

/// Negative logarithm of the restricted likelihood of residuals r under covariance C, with the
/// parameters of J unknown. Source: Patterson and Thompson, "Recovery of inter-block information
/// when block sizes are unequal", Biometrika 1971. Infinite if C has no Cholesky factor.
double RestrictedCost(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& r,
                      const Eigen::MatrixXd& jacobian);

/// The argument with the least value of a function over its logarithm: a grid, then a parabola.
template <class F>
double MinimiseOverLog(double low, double high, const F& f) {
  constexpr int kSteps = 8;
  std::vector<double> values;
  const double ratio = std::pow(high / low, 1.0 / (kSteps - 1));
  int least = 0;
  for (int i = 0; i < kSteps; ++i) {
    values.push_back(f(low * std::pow(ratio, i)));
    if (values.back() < values[static_cast<std::size_t>(least)]) least = i;
  }
  double shift = 0;
  if (least > 0 && least + 1 < kSteps) {
    const auto middle = static_cast<std::size_t>(least);
    const double a = values[middle - 1], b = values[middle], c = values[middle + 1];
    const double bend = a - 2 * b + c;
    if (std::isfinite(bend) && bend > 0) shift = std::clamp(0.5 * (a - c) / bend, -0.5, 0.5);
  }
  return low * std::pow(ratio, least + shift);
}

/// How a smooth depth error moves observations. Row i of `bearings` is (x/z, y/z) of observation i.
/// An error of 1 m at 2 m moves it by levers[i], m.
struct SmoothMovement {
  Eigen::MatrixX2d bearings;
  Eigen::VectorXd levers;

  /// Movement along the surface's normal at a point p of the sensor frame. At grazing incidence a
  /// depth error moves a surface little, but errors across the ray count.
  static double Lever(const DepthErrorModel& errors, const Eigen::Vector3d& p,
                      const Eigen::Vector3d& normal);
  /// The covariance for an error of 1 m at 2 m.
  Eigen::MatrixXd Covariance(double length_rad) const;
};

/// Fits smooth_m and smooth_rad of `errors`. They become the root of the mean square and the mean
/// over all values, weighted by how probable residuals are under them (RestrictedCost). The most
/// probable values would make poses seem better known than they are. smooth_m has a log-normal
/// prior about its current value. `rest`: the covariance of all other errors.
void FitSmoothError(const SmoothMovement& movement, const Eigen::MatrixXd& rest,
                    const Eigen::VectorXd& residuals, const Eigen::MatrixXd& unknown,
                    DepthErrorModel* errors);

}  // namespace volalign::refine_internal
