#pragma once

#include <string>

#include "infer/plan/plan_rig.h"

namespace volalign {

/// Table of the planned sensors, what to be wary of, and who overlaps with whom; for a terminal.
std::string FormatPlan(const RigPlan& plan);

}  // namespace volalign
