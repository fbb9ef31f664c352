#pragma once

#include <string>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// Distances of the edges of a box's outline, seen from above, beyond those of another outline, m;
/// negative if they are set back.
struct Overhang {
  double front = 0, back = 0, right = 0, left = 0;  ///< +x, -x, +z, -z
};

/// One box in the order of building. Metres, degrees.
struct BuildStep {
  int box = 0;  ///< index into Structure::boxes()
  double height = 0;
  double front_to_back = 0, left_to_right = 0;  ///< its own edges that lie flat
  double yaw_deg = 0;                           ///< about +y, from +z towards +x
  /// The boxes below it, the one with the largest shared rectangle first. Empty for a box on the
  /// floor, or on nothing.
  std::vector<int> on;
  bool on_floor = false;
  /// Over the first of `on`; for a box on the floor, over the first one there.
  Overhang overhang;
};

/// The steps from the floor upwards, boxes of one height in the order of the structure.
std::vector<BuildStep> BuildSteps(const Structure& structure);

/// Instructions to build the stack, as an SVG of one A4 page. It shows the stack from two sides,
/// its boxes numbered in the order of building, and the outline on the floor. For each box it says
/// which edge is upright and how far it stands over the one below. Lengths are in mm. Throws
/// DataError for meshes.
std::string BuildSheet(const Structure& structure);

}  // namespace volalign
