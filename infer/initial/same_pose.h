#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign {

/// Are these estimates of about the same pose? The motion between them then moves no corner of the
/// structure by more than half of its smallest edge, limited to 3 to 20 cm. Steps and turns that
/// make a structure look alike move it farther.
bool SamePose(const Structure& structure, const Pose& a, const Pose& b);

}  // namespace volalign
