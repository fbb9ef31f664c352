#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/pose.h"

namespace volalign {

inline constexpr char kLookHint[] =
    "turn the sensor so that it sees most of the structure, from 1.5 to 2.75 m";

/// Clockwise quarter turns from the network's orientation to an upright image. They are the same
/// for all sensors, and most of the placed ones decide (own pose, quarter_turns). Nothing without a
/// placed sensor.
std::optional<int> UprightTurnsOfNetwork(const std::vector<std::pair<Pose, int>>& placed);

/// Says where to move a sensor that sees too few sides: away from the border that cuts the
/// structure off, or round the structure. `labels`: of the stored image. `upright_turns`: clockwise
/// turns that put the stored image upright, if known.
std::string MoveHint(const LabelImage& labels, std::optional<int> upright_turns);

}  // namespace volalign
