#pragma once

#include <string>

#include "core/json/table.h"
#include "infer/plan/plan_rig.h"

namespace volalign {

/// The plan as text for a terminal: a table of the planned sensors, warnings, and how well the
/// sensors are known relative to each other.
std::string FormatPlan(const RigPlan& plan);

/// Its table, one row per sensor, with code, reason and hint of those that are not expected to be
/// ok.
Table PlanTable(const RigPlan& plan);

/// The plan seen from above (RigFromAbove), SVG: the sensors with their expected errors.
std::string PlanPicture(const RigPlan& plan);

}  // namespace volalign
