#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "render/depth_renderer.h"
#include "tests/render/test_scene.h"

namespace volalign {

/// The face that the ray (x, y, 1) meets first, 0 for none, found by looking at each in double.
inline int NearestFace(const SceneMesh& mesh, const Pose& structure_from_sensor,
                       const Eigen::Vector2f& ray) {
  const Eigen::Vector3d eye = structure_from_sensor.translation();
  const Eigen::Vector3d direction =
      structure_from_sensor.linear() * ray.cast<double>().homogeneous();
  double nearest = std::numeric_limits<double>::infinity();
  int found = 0;
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    const SceneFace& face = mesh.faces[i];
    const double height = face.offset - face.normal.dot(eye);
    const double z = height / face.normal.dot(direction);
    if (!(height < 0) || !(z > DepthRenderer::kNear) || !(z < nearest)) continue;
    if (!Inside(face, eye + z * direction)) continue;
    nearest = z;
    found = static_cast<int>(i) + 1;
  }
  return found;
}

/// Draws every picture by OpenGL and by tiles, shows one of them, and counts where they differ.
class BothRenderers : public DepthRenderer {
 public:
  BothRenderers(DepthRenderer& gl, DepthRenderer& tiles, bool shows_gl)
      : gl_(gl), tiles_(tiles), shows_gl_(shows_gl) {}

  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override {
    RenderedView& by_gl = shows_gl_ ? *view : hidden_;
    RenderedView& by_tiles = shows_gl_ ? hidden_ : *view;
    gl_.Render(mesh, intrinsics, structure_from_sensor, &by_gl);
    tiles_.Render(mesh, intrinsics, structure_from_sensor, &by_tiles);
    ASSERT_EQ(by_gl.depth.size(), by_tiles.depth.size());
    EXPECT_EQ(by_gl.rays->rays, by_tiles.rays->rays);
    pixels_ += static_cast<long>(by_gl.depth.size());
    for (std::size_t i = 0; i < by_gl.depth.size(); ++i) {
      EXPECT_EQ(by_tiles.depth[i] > 0, by_tiles.faces[i] > 0);
      if (by_gl.faces[i] != by_tiles.faces[i]) {
        ++other_face_;
        wrong_tiles_ +=
            by_tiles.faces[i] != NearestFace(mesh, structure_from_sensor, by_tiles.rays->rays[i]);
        continue;
      }
      EXPECT_EQ(by_gl.labels[i], by_tiles.labels[i]);
      const double error = std::abs(by_gl.depth[i] - by_tiles.depth[i]);
      if (!(error <= worst_m_)) worst_m_ = error;
    }
  }

  /// Another face in at most `share` of the pixels, which lie at edges, and the same depth
  /// elsewhere; nearly always the tiles' face is the one that the pixel's ray meets. A few small
  /// pictures may differ in a pixel or two.
  void ExpectTheSame(double share = 5e-4) const {
    EXPECT_LE(other_face_, std::max(2L, std::lround(share * static_cast<double>(pixels_))))
        << "of " << pixels_ << " pixels";
    EXPECT_LE(wrong_tiles_, std::max(1L, pixels_ / 20000)) << "of " << pixels_ << " pixels";
    EXPECT_LE(worst_m_, 1e-4);
  }

 private:
  DepthRenderer& gl_;
  DepthRenderer& tiles_;
  bool shows_gl_;
  RenderedView hidden_;
  long pixels_ = 0, other_face_ = 0, wrong_tiles_ = 0;
  double worst_m_ = 0;
};

}  // namespace volalign
