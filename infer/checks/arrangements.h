#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/checks/outcome.h"

namespace volalign {

/// A way in which people build a stack wrongly.
struct Arrangement {
  /// One of the kAssembly codes; kNone: as described.
  SensorCode code = SensorCode::kNone;
  std::string sentence;        ///< "box mid_top is turned by 90 deg"
  std::string box, other_box;  ///< that stand otherwise, where the code is about boxes
  int turn_deg = 0;            ///< about the vertical, from +x towards +z
  Structure structure;         ///< the boxes as they stand; labels are its own
  /// Indices among its boxes of those that stand otherwise, apart from all together.
  std::vector<std::size_t> moved;
};

/// The arrangement as described, first, and every other one that can be told from it:
/// - each box missing, with what stood on it let down;
/// - the stack mirrored;
/// - each box turned by 90, 180 or 270 deg about the column that all boxes share, by 90 deg about
///   its own middle, or laid on another edge;
/// - each two boxes exchanged, each in its own place beside the column or in the other one's.
/// Of several ways to the same boxes in the same places the first is kept, so that exchanges that
/// amount to a mirror image are called mirrored. A box that is turned by half a turn about its own
/// middle, or exchanged with one of the same size, is the same structure to a depth sensor, and is
/// left out.
std::vector<Arrangement> Arrangements(const Structure& structure);

/// The boxes that stand on a box or higher.
std::vector<std::size_t> BoxesAbove(const Structure& structure, std::size_t box);

/// The arrangement with some boxes displaced along the floor by so much, m, what stands on them
/// with them if that is among them. `boxes`: with the lowest one first.
Arrangement Displaced(const Structure& structure, const std::vector<std::size_t>& boxes,
                      const Eigen::Vector3d& offset);

/// The arrangement with a box, and all that stands on it, higher by so much, m, or lower. Below
/// them all there is another box. `boxes`: with the lowest one first.
Arrangement Raised(const Structure& structure, const std::vector<std::size_t>& boxes, double up);

}  // namespace volalign
