#pragma once

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
  Structure structure;         ///< boxes and labels as described, moved
};

/// The arrangement as described, first, and every other one that can be told from it:
/// - each box missing, with what stood on it let down;
/// - the stack mirrored;
/// - each box turned by 90, 180 or 270 deg about the column that all boxes share, or by 90 deg
///   about its own middle;
/// - each two boxes exchanged.
/// Of several ways to the same boxes in the same places the first is kept, so that exchanges that
/// amount to a mirror image are called mirrored. A box that is turned by half a turn about its own
/// middle, or exchanged with one of the same size, is the same structure to a depth sensor, and is
/// left out.
///
/// A side's label goes by the direction that it faces in the stack, as a network that was trained
/// on the described stack labels it: a box that is turned by 90 deg has its front where its left
/// side was.
std::vector<Arrangement> Arrangements(const Structure& structure);

/// The whole stack a quarter turn further about the vertical, from +x towards +z. Its sides are
/// named by the directions that they face.
Structure QuarterTurned(const Structure& structure);

/// Are these the same solids in the same places, to 2 cm, when the whole stack may be turned by
/// quarters and moved? Boxes that stand for missing ones do not count.
bool SameUpToQuarterTurns(const Structure& a, const Structure& b);

}  // namespace volalign
