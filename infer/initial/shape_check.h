#pragma once

#include <optional>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// ViewFit::LogOdds of a pose that geometry found and that was refined since. Nothing if the shape
/// (by kDecisiveOdds), the floor or a tilted side refutes it. This check is closer than the search:
/// other boxes may have the structure's outline to a few centimetres, but their sides face
/// otherwise.
std::optional<double> ShapeLogOdds(const SensorView& view, const Structure& structure,
                                   const Pose& structure_from_sensor);

}  // namespace volalign
