#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/extrinsics.h"
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

/// Points of a sensor within 3 m of the structure's vertical axis, with depths corrected
/// by its gain and offset. None without a pose.
std::vector<AlignedPoint> AlignedPoints(const FrameResult& sensor, const Structure& structure);

/// Writes binary little-endian PLY: x y z red green blue label confidence residual, in the world if
/// there is one. Atomic. Throws IoError.
void WritePly(const std::filesystem::path& path, const std::vector<AlignedPoint>& points,
              const std::optional<WorldFrame>& world = {});

/// The points of one frame.
struct RigCloud {
  std::string sensor;
  std::string capture;               ///< empty for a single capture
  std::vector<AlignedPoint> points;  ///< structure frame of the first capture
};

/// Writes the rig as glTF 2.0 (.glb), in the structure frame, metres: the stack as found, the
/// sensors, and their points, coloured by label. Each placed sensor is a node `NAME` with a camera
/// and the pyramid of its view in lines. A camera of glTF looks along -z with y up:
/// structure_from_sensor times diag(1, -1, -1). `structures`: as found, for each capture; the
/// first's placement is the identity. A sensor node's `extras` have status, structure_from_sensor
/// (16 numbers, row-major) and the intrinsics. A camera of glTF has no principal point and no lens.
/// Throws IoError.
void WriteRigGlb(const std::filesystem::path& path, const Extrinsics& extrinsics,
                 const std::vector<Structure>& structures, const std::vector<RigCloud>& clouds);

}  // namespace volalign
