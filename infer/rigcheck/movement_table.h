#pragma once

#include "core/json/table.h"
#include "infer/rigcheck/movement.h"

namespace volalign {

/// The sensors as the table of FormatRigCheck has them, one row each.
Table MovementTable(const Movements& movements);

}  // namespace volalign
