#pragma once

#include <string>

#include "infer/plan/plan_rig.h"

namespace volalign {

/// The plan seen from above (RigFromAbove), SVG: the sensors with their expected errors.
std::string PlanPicture(const RigPlan& plan);

}  // namespace volalign
