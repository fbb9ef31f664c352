#include "infer/depth/explain_ray.h"

#include <cmath>

namespace volalign {

namespace {

/// m: mean distance from a surface to what is seen behind it, where it is not there. Of the order
/// of a room: half or twice as much moves the boundary between surface and behind by a tenth of a
/// standard deviation.
constexpr double kMeanBehind = 1.5;

}  // namespace

CauseShares Explain(const ExpectedRay& expected, const MeasuredRay& measured,
                    const DepthErrorModel& errors, const CauseShares& usual) {
  if (!(measured.depth > 0)) return {0, 0, 0, 1};
  const double sigma = std::hypot(errors.Sigma(expected.depth), expected.sigma);
  const double at = measured.off / sigma;
  const bool behind = measured.depth > expected.depth;
  CauseShares share{usual[0] * std::exp(-at * at / 2) / (sigma * std::sqrt(2 * M_PI)), 0, 0, 0};
  if (behind) {
    share[2] = usual[2] * std::exp(-measured.off / kMeanBehind) / kMeanBehind;
  } else {
    share[1] = usual[1] / expected.depth;
  }
  const double sum = share[0] + share[1] + share[2];
  // So far off that the normal density is 0, and nothing is usual there.
  if (!(sum > 0)) return {0, behind ? 0.0 : 1.0, behind ? 1.0 : 0.0, 0};
  for (double& each : share) each /= sum;
  return share;
}

}  // namespace volalign
