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

}  // namespace volalign
