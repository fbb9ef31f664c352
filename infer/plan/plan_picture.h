#pragma once

#include <string>

#include "infer/plan/plan_rig.h"

namespace volalign {

/// RigFromAbove of the plan as SVG: the sensors with their expected errors.
std::string PlanPicture(const RigPlan& plan);

}  // namespace volalign
