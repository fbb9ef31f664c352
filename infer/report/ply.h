#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/world_frame.h"

namespace volalign {

/// A point of an aligned cloud, structure frame.
struct AlignedPoint {
  Eigen::Vector3f p = Eigen::Vector3f::Zero();  ///< m
  Rgb colour;                                   ///< of the label; grey for background
  std::uint8_t label = 0;
  float confidence = 0;
  /// m: distance to the label's side, or, for background, to the structure.
  float residual = 0;
  /// m: to the plane of that side, positive outside the box; NaN for background.
  float side_residual = std::numeric_limits<float>::quiet_NaN();
};

/// Points of a sensor within `max_radius` m of the structure's vertical axis, with depths corrected
/// by its gain and offset. None without a pose.
std::vector<AlignedPoint> AlignedPoints(const FrameResult& sensor, const Structure& structure,
                                        double max_radius = 3.0);

/// Writes binary little-endian PLY: x y z red green blue label confidence residual, in the world if
/// there is one. Atomic. Throws IoError.
void WritePly(const std::filesystem::path& path, const std::vector<AlignedPoint>& points,
              const std::optional<WorldFrame>& world = {});

}  // namespace volalign
