#pragma once

#include <string>

#include "core/geometry/structure.h"

namespace volalign {

/// Instructions to build the stack, as an SVG of one A4 page. It shows the stack in isometric view,
/// its boxes numbered in the order of building, and the outline on the floor. For each box it says
/// which edge is upright and how far it stands over the one below. Lengths are in mm. Throws
/// DataError for meshes.
std::string BuildSheet(const Structure& structure);

}  // namespace volalign
