#pragma once

#include <string>

#include "infer/plan_rig.h"

namespace volalign {

/// The plan from above as SVG: the stack, the sensors with what they see of the floor's plane up to
/// the stack's far side, their expected errors, axes and a scale.
std::string PlanPicture(const RigPlan& plan);

}  // namespace volalign
