#pragma once

#include <optional>
#include <string>
#include <vector>

#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What a depth map alone says about a sensor.
struct DepthFinding {
  std::optional<Finding> failure;  ///< no_depth, wrong_units or duplicate_depth
  std::string same_depth_as;       ///< name of another sensor with the same depth map, or empty
};

/// Looks for depth maps that cannot be a view of a structure: without depth, in another unit than
/// stated (half of the depths beyond what a room has, or nearly all nearer than any sensor sees a
/// structure), or equal to another sensor's. Of equal ones the first stays; both name the other.
/// One result a frame; `views` are theirs.
std::vector<DepthFinding> CheckDepths(const std::vector<SensorFrame>& frames,
                                      const std::vector<SensorView>& views);

/// Removes values that stand for "no measurement", 65535 units for example: what a notable share of
/// the pixels has to the last digit, nothing else is near, and no sensor measures in a room.
/// `depth`: m.
void DropStandIns(DepthImage* depth);

}  // namespace volalign
