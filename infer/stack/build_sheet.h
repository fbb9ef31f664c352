#pragma once

#include <string>

#include "core/geometry/structure.h"

namespace volalign {

/// What somebody needs who builds the stack, as an SVG of one A4 page: the stack in isometric view,
/// its boxes numbered in the order of building, the outline on the floor, and for each box which
/// edge is upright and how far it stands over what it stands on. Lengths are printed in mm.
std::string BuildSheet(const Structure& structure);

}  // namespace volalign
