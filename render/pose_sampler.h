#pragma once

#include "core/base/random.h"
#include "core/geometry/pose.h"
#include "render/sample_config.h"

namespace volalign {

/// structure_from_sensor as the paper draws it (Results, "Implementation details"): position
/// (rho cos phi, y, rho sin phi), phi uniform or around one of config.phi_deg; look-at point
/// uniform in a ball about the origin, levelled, then roll and a mounting offset. Throws Error when
/// config.roll_offsets_deg is empty.
Pose SamplePose(const PoseConfig& config, RandomStream& random);

}  // namespace volalign
