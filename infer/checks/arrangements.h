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
  std::string box, other_box;  ///< boxes that stand otherwise, if the code is about boxes
  int turn_deg = 0;            ///< about the vertical, from +x towards +z
  Structure structure;         ///< the boxes as they stand; labels are its own
  /// Indices of its turned, laid, swapped or displaced boxes; empty for other codes.
  std::vector<std::size_t> moved;
};

/// Returns the arrangement as described, then every other one that differs from it. In the next
/// ones a box is missing, and the boxes on it are let down. Then comes the mirrored stack. Then a
/// box is turned by 90, 180 or 270 deg about the column of all boxes, by 90 deg about its own
/// middle, or laid on another edge. In the last ones two boxes are exchanged, each in its own place
/// beside the column or in the other one's.
///
/// If several ways lead to the same boxes in the same places, the first is kept. Exchanges that
/// amount to a mirror image are therefore called mirrored. Half a turn of a box about its own
/// middle is left out, as is an exchange of boxes of one size. To a depth sensor these are the same
/// structure.
std::vector<Arrangement> Arrangements(const Structure& structure);

/// The arrangement with boxes displaced by `offset`, m, along the floor or along y. If all boxes
/// are higher, another box stands below them. `moved`: the lowest one first.
Arrangement Displaced(const Structure& structure, const std::vector<std::size_t>& moved,
                      const Eigen::Vector3d& offset);

}  // namespace volalign
