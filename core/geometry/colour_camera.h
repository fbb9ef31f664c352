#pragma once

#include <optional>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"

namespace volalign {

/// The colour camera beside a depth camera, by the device's calibration.
struct ColourCamera {
  /// p_colour = T p_depth, metres; both frames x right, y down, z forward.
  Pose colour_from_depth = Pose::Identity();
  std::optional<Intrinsics> intrinsics;  ///< of the colour pictures, if known
};

}  // namespace volalign
