#pragma once

#include <optional>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"

namespace volalign {

/// The colour camera beside a depth camera, as the device's calibration has it.
struct ColourCamera {
  /// p_colour = T p_depth, metres; both frames x right, y down, z forward.
  Pose colour_from_depth = Pose::Identity();
  std::optional<Intrinsics> intrinsics;  ///< of the colour pictures, where they are known
};

}  // namespace volalign
