#pragma once

#include "core/json/table.h"
#include "infer/rigcheck/movement.h"

namespace volalign {

/// The table of FormatRigCheck, one row per sensor.
Table MovementTable(const Movements& movements);

}  // namespace volalign
