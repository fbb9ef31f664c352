#pragma once

#include <optional>
#include <string>
#include <vector>

#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The depths of a map where there are any.
std::vector<float> MeasuredDepths(const DepthImage& depth);

/// The findings in a depth map alone.
struct DepthFinding {
  std::optional<Finding> failure;  ///< no_depth, wrong_units or duplicate_depth
  std::string same_depth_as;       ///< name of another sensor with the same depth map, or empty
};

/// Finds depth maps that cannot be a view of a structure. They are without depth, equal to another
/// sensor's, or in another unit than stated. In another unit, half of the depths are beyond a room,
/// or nearly all are nearer than any sensor sees a structure. The first of equal ones is kept, and
/// both name the other. There is one result per frame; `views` are those of `frames`.
std::vector<DepthFinding> CheckDepths(const std::vector<SensorFrame>& frames,
                                      const std::vector<SensorView>& views);

/// Removes values that stand for "no measurement", for example 65535 units. A notable share of the
/// pixels has such a value to the last digit, and nothing else is near it. No sensor measures it in
/// a room. `depth`: m.
void DropStandIns(DepthImage* depth);

}  // namespace volalign
