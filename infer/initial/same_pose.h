#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign {

/// Are these two estimates of about the same pose? They are where the structure stands nearly alike
/// at both: none of its corners is moved by more than half of its smallest edge, but by 3 to 20 cm
/// at most. Steps and turns that make a structure look alike move it by more.
bool SamePose(const Structure& structure, const Pose& a, const Pose& b);

}  // namespace volalign
