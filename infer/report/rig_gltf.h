#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/report/extrinsics.h"
#include "infer/report/ply.h"

namespace volalign {

/// The points of one frame.
struct RigCloud {
  std::string sensor;
  std::string still;                 ///< empty where there is only one
  std::vector<AlignedPoint> points;  ///< structure frame of the first still
};

/// Writes the rig as glTF 2.0 (.glb), in the structure's frame, metres: the stack as found, of each
/// placed sensor a node `NAME` with a camera and the pyramid of its view in lines (glTF's cameras
/// look along -z with y up: structure_from_sensor times diag(1, -1, -1)), and its points, coloured
/// by label. `structures`: as found, of each still; the first's placement is the identity. A sensor
/// node's `extras` have status, structure_from_sensor (16 numbers, row-major) and the intrinsics,
/// whose principal point and lens glTF cannot say. Throws IoError.
void WriteRigGlb(const std::filesystem::path& path, const Extrinsics& extrinsics,
                 const std::vector<Structure>& structures, const std::vector<RigCloud>& clouds);

}  // namespace volalign
