#pragma once

#include <string>

#include "core/geometry/structure.h"
#include "core/json/table.h"
#include "infer/initial/target_quality.h"

namespace volalign {

/// The merits and faults of a structure as a target, for a terminal.
std::string FormatTarget(const Structure& structure, const TargetQuality& quality);

/// Its table: one row per height of the sensors.
Table TargetTable(const TargetQuality& quality);

/// The same as an SVG. It has a cell for each view, direction by height, coloured by how well it
/// fixes the sensor's position. Marks show views that fix no pose or that a symmetry shares. Beside
/// them is the stack from above, with the directions.
std::string TargetPicture(const Structure& structure, const TargetQuality& quality);

}  // namespace volalign
