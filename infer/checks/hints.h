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

/// Turns by which the network's orientation of these placed sensors (own pose, quarter_turns) has
/// to be turned on to be upright: it is the same for all, and most of them decide. Nothing without
/// a placed sensor.
std::optional<int> UprightTurnsOfNetwork(const std::vector<std::pair<Pose, int>>& placed);

/// Where to move a sensor that sees too few sides: away from the border that cuts the structure
/// off, or round the structure. `labels`: of the stored image. `upright_turns`: clockwise turns
/// that put the stored image upright, where they are known.
std::string MoveHint(const LabelImage& labels, std::optional<int> upright_turns);

}  // namespace volalign
