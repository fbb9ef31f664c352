#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/result.h"

namespace volalign {

/// The placed sensors from above as SVG (RigFromAbove). Each name has its horizontal distance from
/// the structure's origin and its height above the floor. With `alternative`, the sensors are as in
/// that set, without ellipses; other poses have another colour.
std::string PlacedFromAbove(const std::vector<FrameResult>& sensors, const Structure& built,
                            const RigAlternative* alternative = nullptr);

/// The page's content on another set of the rig's poses: the rig from above and each sensor with
/// another pose. A sensor has its picture with the edges at that pose, and the difference of the
/// structure's outlines at both poses. The difference is 1 - intersection over union of the pixels
/// that show it. `of_capture`: the sensors with their images, of the capture with this choice.
/// Their poses and `built` are in the structure as it stood then. `sensors`: of all captures.
nlohmann::ordered_json AlternativeJson(const RigAlternative& alternative,
                                       const std::vector<FrameResult>& sensors,
                                       const std::vector<FrameResult>& of_capture,
                                       const Structure& built, const Pose& first_from_placement);

}  // namespace volalign
