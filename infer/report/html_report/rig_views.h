#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/result.h"

namespace volalign {

/// The placed sensors from above as SVG (RigFromAbove), by each name its horizontal distance from
/// the structure's origin and its height above the floor. With `alternative`, as that set has them:
/// without ellipses, and in another colour where a pose is another one.
std::string PlacedFromAbove(const std::vector<FrameResult>& sensors, const Structure& built,
                            const RigAlternative* alternative = nullptr);

/// What the page shows of a set of poses that the rig may have instead: the rig from above, of each
/// sensor whose pose is another one its picture with the edges at that pose, and by how much the
/// structure's outlines at both poses differ (1 - intersection over union of the pixels that show
/// it). `of_still`: the sensors with their images, of the still whose choice it is; their poses,
/// and `built`, in the structure as it stood then. `sensors`: of all stills.
nlohmann::ordered_json AlternativeJson(const RigAlternative& alternative,
                                       const std::vector<FrameResult>& sensors,
                                       const std::vector<FrameResult>& of_still,
                                       const Structure& built, const Pose& first_from_placement);

}  // namespace volalign
