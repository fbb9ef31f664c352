#pragma once

#include <optional>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Of a pose that geometry has found and that was refined since: ViewFit::LogOdds, if they do not
/// refute it (kDecisiveOdds). It is looked at more closely then: other boxes may have the
/// structure's outline to a few centimetres, but they do not face as its sides do.
std::optional<double> ShapeLogOdds(const SensorView& view, const Structure& structure,
                                   const Pose& structure_from_sensor);

}  // namespace volalign
