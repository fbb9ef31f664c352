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
