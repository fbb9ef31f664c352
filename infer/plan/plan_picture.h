#pragma once

#include <string>
#include <vector>

#include "core/plot/svg.h"
#include "infer/plan/plan_rig.h"

namespace volalign {

/// The plan from above as SVG: the stack, the sensors with what they see of the floor's plane up to
/// the stack's far side, their expected errors, axes and a scale.
std::string PlanPicture(const RigPlan& plan);

/// Corners of a box's upper side, in order, structure frame, m.
std::vector<Eigen::Vector3d> TopOf(const Box& box);

/// The structure's axes from above, x to the right and z downwards, `length` px long.
void DrawAxes(const Svg::Point& origin, double length, Svg* svg);

}  // namespace volalign
