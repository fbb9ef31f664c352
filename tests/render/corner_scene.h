#pragma once

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/scene_mesh.h"

namespace volalign {

inline Intrinsics CentredCamera(int width, int height, double f) {
  return {width, height, f, f, 0.5 * width - 0.5, 0.5 * height - 0.5, {}};
}

/// The structure on a bright floor, whose concave corner with the lowest box is in the middle of
/// the picture.
struct CornerScene {
  SceneMesh mesh;
  Intrinsics k = CentredCamera(160, 144, 126);
  Pose pose = LookAt({2.2, 0.4, 0}, {0.4, -0.5, 0}, 0);
  RenderedView view;

  CornerScene(const Structure& structure, DepthRenderer& renderer) {
    mesh.AppendStructure(structure);
    mesh.BeginObject({0.9F, 1.0F, false});
    const double y = structure.FloorHeight();
    mesh.AppendQuad({Eigen::Vector3d(-9, y, -9), Eigen::Vector3d(9, y, -9),
                     Eigen::Vector3d(9, y, 9), Eigen::Vector3d(-9, y, 9)},
                    Eigen::Vector3d::UnitY());
    renderer.Render(mesh, k, pose, &view);
  }
};

}  // namespace volalign
