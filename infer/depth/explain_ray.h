#pragma once

#include <array>
#include <cstddef>

#include "core/geometry/depth_error_model.h"

namespace volalign {

/// Why a sensor measured what it did along a ray on which a surface is expected: it measured that
/// surface, something before it, something behind it, which the surface would have hidden, or
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

/// What was measured there.
struct MeasuredRay {
  double depth = 0;  ///< m; 0: nothing
  /// Distance, m, of the measured point from the surface, at most the difference of the depths:
  /// along a grazing ray, or one that passes an edge, the depth changes fast and this does not.
  double off = 0;
};

/// The probability of each cause, given what was measured; the sum is 1. Depths are distributed
/// normally about the surface, with the sensor's errors and the surface's own; evenly before it, as
/// nothing is known of what may stand there; and exponentially behind it, as rooms are. Of
/// all rays, two in a thousand are taken to measure something before it, and as many something
/// behind it.
CauseShares Explain(const ExpectedRay& expected, const MeasuredRay& measured,
                    const DepthErrorModel& errors);

}  // namespace volalign
