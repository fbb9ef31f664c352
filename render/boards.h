#pragma once

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/scene_mesh.h"

namespace volalign {

/// From where a board reaches into a sensor's view: the upper parts of an upright board's edge, or
/// the top of a low one.
enum class BoardEdge { kLeft, kRight, kBelow };
inline constexpr int kBoardEdges = 3;

/// Appends a board that stands on the floor 0.7 m before a sensor and hides a share, in (0, 1], of
/// the sensor's rays to the structure: those that lie farthest to one side, or lowest. Nothing is
/// appended where the sensor does not see the structure. `rays`: the sensor's.
void AppendBoard(const Structure& structure, const RayTable& rays,
                 const Pose& structure_from_sensor, double share, BoardEdge edge, SceneMesh* mesh);

}  // namespace volalign
