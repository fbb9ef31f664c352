#pragma once

#include "core/base/random.h"
#include "core/geometry/pose.h"
#include "render/sample_config.h"

namespace volalign {

/// Draws structure_from_sensor as the paper does (Results, "Implementation details"). The position
/// is (rho cos phi, y, rho sin phi), with phi uniform or around one of config.phi_deg. The look-at
/// point is uniform in a ball about the origin. The sensor is levelled, then turned by a roll and a
/// mounting offset. Throws Error if config.roll_offsets_deg is empty.
Pose SamplePose(const PoseConfig& config, RandomStream& random);

}  // namespace volalign
