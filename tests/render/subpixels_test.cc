#include "render/subpixels.h"

#include <gtest/gtest.h>

#include "core/geometry/structure.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "tests/core/base/pixels.h"

namespace volalign {
namespace {

/// The paper's stack alone, from `eye`.
struct Seen {
  Intrinsics k{160, 144, 126, 126, 79.5, 71.5, {}};
  Pose pose;
  SceneMesh mesh;
  RenderedView view;
  Structure structure = ReadStructure("configs/structure.yaml");
  std::string sensor = "azure_kinect";

  explicit Seen(const Eigen::Vector3d& eye) : pose(LookAt(eye, {0, 0, 0}, 0)) {
    mesh.AppendStructure(structure);
    for (SceneObject& object : mesh.objects) object.is_structure = true;
    EglContext egl;
    GlDepthRenderer renderer;
    renderer.Render(mesh, k, pose, &view);
  }
  NoiseInput Input() const { return {view, mesh, structure, k, pose, sensor}; }
};

TEST(Subpixels, FindsTheFacesOfPixelsAlongTheirRays) {
  const Seen seen({1.4, 0.3, 1.4});
  const Subpixels subpixels(seen.Input());
  int shown = 0, found = 0;
  for (const auto [u, v] : Pixels(seen.k.width, seen.k.height)) {
    const int face = seen.view.faces(u, v) - 1;
    if (face < 0) continue;
    ++shown;
    const Eigen::Vector3f ray = subpixels.Ray(u, v);
    found += subpixels.FaceAlong(ray, u, v) == face;
    EXPECT_NEAR(subpixels.Depth(face, ray), seen.view.depth(u, v), 0.03);
  }
  EXPECT_GT(shown, 2000);
  // Pixels whose centre lies on an edge, to rounding, may be either face's.
  EXPECT_GE(found, shown - 3);
}

TEST(Subpixels, ASideBulgesAlikeForAllWhoSeeIt) {
  const Seen seen({1.4, 0.3, 1.4}), from_elsewhere({1.7, -0.1, 1.1});
  const Subpixels a(seen.Input()), b(from_elsewhere.Input());
  ASSERT_EQ(seen.mesh.faces.size(), from_elsewhere.mesh.faces.size());
  int bulged = 0;
  for (int i = 0; i < static_cast<int>(seen.mesh.faces.size()); ++i) {
    EXPECT_EQ(a.face(i).bulge, b.face(i).bulge);
    EXPECT_LT(std::abs(a.face(i).bulge), 0.01F);
    bulged += a.face(i).bulge != 0;
    // In the middle, towards the sensor where it is outwards, and not at the border.
    const SeenFace& face = a.face(i);
    if (!(face.height > 0.1F)) continue;
    const Eigen::Vector3f middle = face.corner + 0.5F * (face.along_u + face.along_v);
    if (!(middle.z() > 0.1F)) continue;
    EXPECT_NEAR(face.normal.dot(a.Depth(i, middle / middle.z()) * middle / middle.z() - middle),
                face.bulge, 1e-4);
    const Eigen::Vector3f border = face.corner + 0.5F * face.along_u;
    EXPECT_NEAR(a.Depth(i, border / border.z()), border.z(), 1e-4);
  }
  EXPECT_GT(bulged, 10);
}

}  // namespace
}  // namespace volalign
