#pragma once

#include <array>
#include <cstddef>

#include "core/geometry/depth_error_model.h"

namespace volalign {

/// Why a sensor measured this depth along a ray on which a surface is expected. It measured the
/// surface, something before it, something behind it (which the surface would have hidden), or
/// nothing.
enum class Cause { kSurface, kBefore, kBehind, kMissing };
inline constexpr std::size_t kCauses = static_cast<std::size_t>(Cause::kMissing) + 1;

/// A number for each cause, in their order: shares, or counts.
using CauseShares = std::array<double, kCauses>;

/// Where a surface is expected.
struct ExpectedRay {
  double depth = 0;  ///< along the optical axis, m; > 0
  double sigma = 0;  ///< standard deviation, m, of the surface's place: by its pose, by its boxes
};

/// The measurement there.
struct MeasuredRay {
  double depth = 0;  ///< m; 0: nothing
  /// Distance, m, of the measured point from the surface, at most the difference of the depths.
  /// Along a grazing ray, or one that passes an edge, the depth changes fast and this does not.
  double off = 0;
};

/// The probability of each cause, given the measurement; the sum is 1. Depths on the surface are
/// distributed normally, with the sensor's errors and the surface's own. Depths before it are
/// distributed evenly, as nothing is known of objects there, and depths behind it exponentially, as
/// in rooms. Two in a thousand of all rays measure something before it, and as many something
/// behind it.
CauseShares Explain(const ExpectedRay& expected, const MeasuredRay& measured,
                    const DepthErrorModel& errors);

}  // namespace volalign
