#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "render/depth_renderer.h"

namespace volalign {

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

}  // namespace volalign
