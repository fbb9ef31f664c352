#include "infer/depth/explain_ray.h"

#include <cmath>

namespace volalign {

namespace {

/// m: mean distance from a missing surface to the next one behind it, about the size of a room.
/// Half or twice as much moves the boundary between surface and behind by a tenth of a standard
/// deviation.
constexpr double kMeanBehind = 2;
/// Share of rays that measure something behind the structure at its pose, of those on which it is
/// expected, in recorded frames (tests/bench/cause_shares.py). Nothing stands before their stacks:
/// the share before it is assumed to be the same.
constexpr double kSeldom = 0.002;

}  // namespace

CauseShares Explain(const ExpectedRay& expected, const MeasuredRay& measured,
                    const DepthErrorModel& errors) {
  if (!(measured.depth > 0)) return {0, 0, 0, 1};
  const double sigma = std::hypot(errors.Sigma(expected.depth), expected.sigma);
  const double at = measured.off / sigma;
  const bool behind = measured.depth > expected.depth;
  CauseShares share{std::exp(-at * at / 2) / (sigma * std::sqrt(2 * M_PI)), 0, 0, 0};
  if (behind) {
    share[2] = kSeldom * std::exp(-measured.off / kMeanBehind) / kMeanBehind;
  } else {
    share[1] = kSeldom / expected.depth;
  }
  const double sum = share[0] + share[1] + share[2];
  // So far off that all densities are 0.
  if (!(sum > 0)) return {0, behind ? 0.0 : 1.0, behind ? 1.0 : 0.0, 0};
  for (double& each : share) each /= sum;
  return share;
}

}  // namespace volalign
