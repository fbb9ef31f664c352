#pragma once

#include <cstdint>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/scene_mesh.h"

namespace volalign {

inline Intrinsics CentredCamera(int width, int height, double f) {
  return {width, height, f, f, 0.5 * width - 0.5, 0.5 * height - 0.5, {}};
}

/// A fronto-parallel wall at `z` m from a level sensor, and a square plate of `half` m to each side
/// of the axis at `plate_z` m, none where that is 0. Both count as structure, so that they are well
/// textured and bright; far from its boxes.
struct WallScene {
  WallScene() = default;
  WallScene(DepthRenderer& renderer, const Intrinsics& k, double z, double plate_z, double half) {
    constexpr double kFar = 10, kY = 2;
    pose = LookAt({kFar - z, kY, 0}, {kFar, kY, 0}, 0);
    const auto square = [this](double x, double r, std::uint8_t label) {
      mesh.BeginObject({0.9F, 1.0F, true});
      mesh.AppendQuad({Eigen::Vector3d(x, kY - r, -r), Eigen::Vector3d(x, kY + r, -r),
                       Eigen::Vector3d(x, kY + r, r), Eigen::Vector3d(x, kY - r, r)},
                      -Eigen::Vector3d::UnitX(), label);
    };
    square(kFar, 90, 1);
    if (plate_z > 0) square(kFar - z + plate_z, half, 2);
    renderer.Render(mesh, k, pose, &view);
  }

  SceneMesh mesh;
  Pose pose = Pose::Identity();
  RenderedView view;
};

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
