#pragma once

#include <array>
#include <vector>

namespace volalign::refine_internal {

/// The parameters that are estimated beside the poses and the nuisances that are always free.
struct FreeSet {
  bool boxes = false, size = false, gain = false, offset = false;
  std::vector<char> lens;  ///< of each lens
};

/// Parameters that share a prior scale: places (x, z) and turns of boxes, the size, depth gains,
/// depth offsets.
enum PriorGroup { kPlaces, kTurns, kSizes, kGains, kOffsets, kPriorGroups };

/// How far the parameters of each group deviate from their nominal values: a factor on their prior
/// standard deviations.
using PriorScales = std::array<double, kPriorGroups>;
inline constexpr PriorScales kWholePriors = {1, 1, 1, 1, 1};

}  // namespace volalign::refine_internal
