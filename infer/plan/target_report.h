#pragma once

#include <string>

#include "core/geometry/structure.h"
#include "core/json/table.h"
#include "infer/initial/target_quality.h"

namespace volalign {

/// What speaks for a structure as a target and what against it; for a terminal.
std::string FormatTarget(const Structure& structure, const TargetQuality& quality);

/// Its table: one row per height of the sensors.
Table TargetTable(const TargetQuality& quality);

/// The same as an SVG: a cell for each view, direction by height, coloured by how well it fixes the
/// sensor's position, with marks for views that fix no pose or that an alias shares; and the stack
/// from above, with the directions.
std::string TargetPicture(const Structure& structure, const TargetQuality& quality);

}  // namespace volalign
