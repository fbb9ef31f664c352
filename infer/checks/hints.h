#pragma once

#include <string>

#include "core/base/image.h"

namespace volalign {

inline constexpr char kLookHint[] =
    "turn the sensor so that it sees most of the structure, from 1.5 to 2.75 m";

/// Says where to move a sensor that sees too few sides: towards what the border of its picture cuts
/// off, or round the structure. `labels`: of the stored image.
std::string MoveHint(const LabelImage& labels);

}  // namespace volalign
