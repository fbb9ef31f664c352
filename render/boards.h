#pragma once

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/scene_mesh.h"

namespace volalign {

/// The side from which a board reaches into a sensor's view. Left and right boards are upright; the
/// one from below is low.
enum class BoardEdge { kLeft, kRight, kBelow };
inline constexpr int kBoardEdges = 3;

/// Appends a board that stands on the floor 0.7 m before a sensor. It hides a share, in (0, 1], of
/// the sensor's rays to the structure: those farthest to one side, or the lowest. Appends nothing
/// if the sensor does not see the structure. `rays`: the sensor's.
void AppendBoard(const Structure& structure, const RayTable& rays,
                 const Pose& structure_from_sensor, double share, BoardEdge edge, SceneMesh* mesh);

}  // namespace volalign
