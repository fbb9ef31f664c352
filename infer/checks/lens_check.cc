#include "infer/checks/lens_check.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <cmath>

namespace volalign {

namespace {

/// A lens is suspect if it differs by so many standard deviations from one that makes large planes
/// flat, and bends them by so much, m.
constexpr double kBentSigmas = 4, kLeastBend = 0.008;
/// Most standard deviations of its prior by which a focal length may differ: one in 80 right ones
/// exceeds them.
constexpr double kMostFocalSigmas = 2.5;

/// The further change that makes planes flat if the lens's prior is left out. `sigmas`: by how many
/// standard deviations, those of the prior included, k1 and k2 are off.
struct Excess {
  LensChange change = LensChange::Zero();
  double sigmas = 0;
};

Excess ExcessOf(const LensEvidence& evidence, const SensorLens& lens) {
  const Eigen::Vector3d wide = PriorOfLens({}, "").sigmas;
  LensEvidence further = evidence;
  further.moment -= evidence.information * lens.change;
  const LensEstimate estimate = EstimateLens(further, wide);
  Eigen::Matrix2d covariance = estimate.covariance.bottomRightCorner<2, 2>();
  covariance += lens.prior_sigmas.tail<2>().cwiseAbs2().asDiagonal();
  const Eigen::Vector2d k = estimate.change.tail<2>();
  return {estimate.change, std::sqrt(k.dot(covariance.inverse() * k))};
}

}  // namespace

PerFrame<std::optional<Finding>> CheckLenses(const PerFrame<SensorPlanes>& planes,
                                             const LensSet& lenses, bool estimated) {
  return MapFrames(planes, 1, [&](FrameId id) -> std::optional<Finding> {
    const SensorLens& lens = lenses.Of(id);
    const Excess excess =
        ExcessOf(Straightness({planes[id]}).EvidenceAt({lenses.assumed[id]}, lens.change), lens);
    const double bend = LargestBend(planes[id], excess.change);
    // This comes before the focal length, which also changes where distortion is left out.
    if (excess.sigmas > kBentSigmas && bend > kLeastBend) {
      return Finding{
          SensorCode::kLensSuspect,
          fmt::format("flat surfaces look bent by up to {:.0f} mm: its lens is not the one that "
                      "the intrinsics describe",
                      1000 * bend),
          estimated ? "check that depth is measured along the optical axis and not along each ray, "
                      "then the intrinsics with their distortion. Or leave the distortion out and "
                      "name the sensor's kind (capture.json, sensor): it is then estimated"
                    : "give the lens's distortion in the capture, or have it estimated "
                      "(--estimate auto)"};
    }
    // The focal length may be off that of other sensors of its kind, or off the given one.
    const double own = lenses.own_focal[id];
    const bool alone =
        lens.own_focal_sigma > 0 && std::abs(own) > kMostFocalSigmas * lens.own_focal_sigma;
    const double focal = alone ? own : lenses.ChangeOf(id)[0],
                 usual = alone ? lens.own_focal_sigma
                               : std::hypot(lens.prior_sigmas[0], lens.own_focal_sigma);
    if (std::abs(focal) > kMostFocalSigmas * usual) {
      const Intrinsics found = lenses.Effective(id);
      return Finding{SensorCode::kIntrinsicsSuspect,
                     fmt::format("its focal length differs by {0:+.1f} % from {1} (fx = {3:.1f}, "
                                 "fy = {4:.1f}); differences of {2:.1f} % are usual",
                                 100 * std::expm1(focal),
                                 alone ? "those of others of its kind" : "the one given",
                                 100 * usual, found.fx, found.fy),
                     "give the intrinsics of this sensor, at this resolution"};
    }
    return std::nullopt;
  });
}

}  // namespace volalign
