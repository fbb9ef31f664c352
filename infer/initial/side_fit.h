#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/side_patch.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Brings each patch's points onto its finite side: options.side_fit_steps Gauss-Newton steps,
/// Cauchy-weighted with a scale that shrinks from step to step. The centroids of what is visible
/// fix the directions along the sides, since points that lie within a rectangle could slide in it.
/// Held-out points, which are to judge the refinement, are left out.
Pose FitToSides(const SensorView& view, const std::vector<SidePatch>& patches,
                const Structure& structure, const InitialPoseOptions& options, Pose pose);

}  // namespace volalign
