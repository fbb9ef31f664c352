#include "core/geometry/lens.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "core/base/error.h"

namespace volalign {

namespace {

/// The radial part of the model is tabulated in these steps up to this radius on the plane z = 1
/// (87 deg off the axis). The table ends earlier if the model folds over.
constexpr double kWidestRadius = 20;
constexpr double kRadiusStep = 0.005;
/// Newton's method starts from that table and usually takes two steps.
constexpr int kNewtonSteps = 20;
constexpr double kConvergedPx = 1e-6;
/// With tangential distortion a ray may fold over at a slightly larger radius than the table's.
constexpr double kFoldMargin = 0.02;

struct Coefficients {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;

  explicit Coefficients(const Intrinsics& intrinsics) {
    std::array<double, 8> k{};
    std::copy(intrinsics.distortion.begin(), intrinsics.distortion.end(), k.begin());
    k1 = k[0], k2 = k[1], p1 = k[2], p2 = k[3], k3 = k[4], k4 = k[5], k5 = k[6], k6 = k[7];
  }
  double Numerator(double r2) const { return 1 + r2 * (k1 + r2 * (k2 + r2 * k3)); }
  double Denominator(double r2) const { return 1 + r2 * (k4 + r2 * (k5 + r2 * k6)); }
  /// Radial factor, and its derivative by r^2.
  double Radial(double r2, double* derivative) const {
    const double inverse = 1 / Denominator(r2), radial = Numerator(r2) * inverse;
    *derivative =
        (k1 + r2 * (2 * k2 + r2 * 3 * k3) - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) * inverse;
    return radial;
  }
  /// The ray after the lens bent it, on the plane z = 1, and the derivative by the ray.
  Eigen::Vector2d Bend(const Eigen::Vector2d& ray, Eigen::Matrix2d* jacobian) const {
    const double x = ray.x(), y = ray.y(), r2 = x * x + y * y;
    double slope = 0;
    const double radial = Radial(r2, &slope);
    const double cross = 2 * (slope * x * y + p1 * x + p2 * y);
    *jacobian << radial + 2 * slope * x * x + 2 * p1 * y + 6 * p2 * x, cross,  //
        cross, radial + 2 * slope * y * y + 6 * p1 * y + 2 * p2 * x;
    return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  }
};

/// Inverts the lens model.
class LensInverse {
 public:
  explicit LensInverse(const Intrinsics& intrinsics)
      : lens_(intrinsics), tolerance_(kConvergedPx / std::min(intrinsics.fx, intrinsics.fy)) {
    double slope = 0;
    for (double r = 0; r <= kWidestRadius; r += kRadiusStep) {
      const double r2 = r * r, radial = lens_.Radial(r2, &slope);
      const bool rises = lens_.Denominator(r2) > 0 && radial + 2 * r2 * slope > 0;
      if (!rises || (!bent_.empty() && r * radial <= bent_.back())) break;
      bent_.push_back(r * radial);
    }
    fold_ = static_cast<double>(bent_.size()) * kRadiusStep;
  }

  /// The ray that the lens bends to `target`, both on the plane z = 1. It is found fastest if the
  /// last target was near.
  std::optional<Eigen::Vector2d> operator()(const Eigen::Vector2d& target) {
    const double bent = target.norm();
    Eigen::Vector2d ray = bent > 0 ? Eigen::Vector2d(target * (Radius(bent) / bent)) : target;
    const double widest = fold_ * (1 + kFoldMargin);
    Eigen::Matrix2d jacobian;
    for (int i = 0; i < kNewtonSteps; ++i) {
      const Eigen::Vector2d error = lens_.Bend(ray, &jacobian) - target;
      if (!(jacobian.determinant() > 0) || !(ray.squaredNorm() <= widest * widest)) break;
      if (error.squaredNorm() <= tolerance_ * tolerance_) return ray;
      ray -= jacobian.inverse() * error;
    }
    return std::nullopt;
  }

 private:
  /// Radius that the radial part alone bends to `bent`, or else the widest one.
  double Radius(double bent) {
    while (last_ > 0 && bent_[last_] > bent) --last_;
    while (last_ + 1 < bent_.size() && bent_[last_ + 1] <= bent) ++last_;
    if (last_ + 1 == bent_.size()) return static_cast<double>(last_) * kRadiusStep;
    const double low = bent_[last_];
    return (static_cast<double>(last_) + (bent - low) / (bent_[last_ + 1] - low)) * kRadiusStep;
  }

  Coefficients lens_;
  double tolerance_;
  std::vector<double> bent_;  ///< of radii in steps of kRadiusStep, rising
  std::size_t last_ = 0;      ///< of the last radius
  double fold_ = 0;           ///< radius beyond which the model does not rise
};

/// `ray_of`: the ray, or nothing, of a point that the lens bends it to, both on the plane z = 1.
template <class RayOf>
RayTable RaysBy(const Intrinsics& intrinsics, RayOf ray_of) {
  RayTable table{intrinsics.width, intrinsics.height, {}};
  table.rays.reserve(static_cast<std::size_t>(table.width) *
                     static_cast<std::size_t>(table.height));
  for (int v = 0; v < table.height; ++v) {
    for (int u = 0; u < table.width; ++u) {
      const std::optional<Eigen::Vector2d> ray = ray_of(Eigen::Vector2d(
          (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy));
      table.rays.push_back(
          ray ? Eigen::Vector2f(ray->cast<float>())
              : Eigen::Vector2f::Constant(std::numeric_limits<float>::quiet_NaN()));
    }
  }
  return table;
}

}  // namespace

BentRay BendRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray) {
  const Coefficients lens(intrinsics);
  BentRay bent;
  bent.bent = lens.Bend(ray, &bent.by_ray);
  bent.denominator = lens.Denominator(ray.squaredNorm());
  return bent;
}

Eigen::Vector2d ProjectRay(const Intrinsics& intrinsics, const Eigen::Vector2d& ray) {
  const Eigen::Vector2d bent = BendRay(intrinsics, ray).bent;
  return {intrinsics.fx * bent.x() + intrinsics.cx, intrinsics.fy * bent.y() + intrinsics.cy};
}

void RequireRays(const Intrinsics& intrinsics, const std::string& what) {
  if (intrinsics.distortion.empty()) return;
  constexpr int kSteps = 32;
  LensInverse inverse(intrinsics);
  int lost = 0;
  for (int j = 0; j < kSteps; ++j) {
    for (int i = 0; i < kSteps; ++i) {
      const double u = (i + 0.5) / kSteps * intrinsics.width,
                   v = (j + 0.5) / kSteps * intrinsics.height;
      lost += !inverse({(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy});
    }
  }
  if (2 * lost <= kSteps * kSteps) return;
  throw DataError(fmt::format(
      "{}: the distortion coefficients cannot be inverted at {:.0f} % of the picture; check their "
      "order (k1 k2 p1 p2 k3 k4 k5 k6) and that they belong to these intrinsics",
      what, 100.0 * lost / (kSteps * kSteps)));
}

RayTable ComputeRays(const Intrinsics& intrinsics) {
  intrinsics.Validate("ComputeRays");
  RequireRays(intrinsics, "ComputeRays");
  if (!intrinsics.distortion.empty()) return RaysBy(intrinsics, LensInverse(intrinsics));
  return RaysBy(intrinsics, [](const Eigen::Vector2d& at) { return at; });
}

}  // namespace volalign
