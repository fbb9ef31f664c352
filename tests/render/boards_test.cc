#include "render/boards.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "tests/core/base/pixels.h"

namespace volalign::boards_test {
namespace {

Intrinsics Pinhole() {
  Intrinsics intrinsics;
  intrinsics.width = 96;
  intrinsics.height = 72;
  intrinsics.fx = intrinsics.fy = 60;
  intrinsics.cx = 47.5;
  intrinsics.cy = 35.5;
  return intrinsics;
}

/// Whether the ray from the origin meets the convex body before `reach`.
bool Meets(const SceneMesh& body, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
           double reach) {
  double enter = 0, leave = reach;
  for (const SceneFace& face : body.faces) {
    const double rate = face.normal.dot(direction), gap = face.offset - face.normal.dot(origin);
    if (rate > 0) leave = std::min(leave, gap / rate);
    if (rate < 0) enter = std::max(enter, gap / rate);
    if (rate == 0 && gap < 0) return false;
  }
  return enter < leave;
}

class Boards : public testing::Test {
 protected:
  Structure structure_ = ReadStructure("configs/structure.yaml");
  RayTable rays_ = ComputeRays(Pinhole());
  Pose pose_ = LookAt({1.5, 0.5, 1.2}, {0, 0, 0}, 0);
};

TEST_F(Boards, HideTheShareThatLiesFarthestToTheirSide) {
  const ExpectedView view = CastView(structure_, rays_, pose_);
  for (const BoardEdge edge : {BoardEdge::kLeft, BoardEdge::kRight, BoardEdge::kBelow}) {
    for (const double share : {0.2, 0.7}) {
      SCOPED_TRACE(static_cast<int>(edge) + share);
      SceneMesh mesh;
      AppendBoard(structure_, rays_, pose_, share, edge, &mesh);
      ASSERT_EQ(mesh.faces.size(), 6u);
      double lowest = 1;
      for (const SceneFace& face : mesh.faces) {
        for (const Eigen::Vector3f& corner : face.corners)
          lowest = std::min(lowest, static_cast<double>(corner.y()));
      }
      EXPECT_NEAR(lowest, structure_.FloorHeight(), 1e-5);  // it stands on the floor
      int hidden = 0, seen = 0;
      double u_hidden = 0, u_seen = 0, v_hidden = 0, v_seen = 0;
      for (const auto [u, v] : Pixels(rays_.width, rays_.height)) {
        if (view.labels(u, v) == 0) continue;
        const Eigen::Vector3d ray(rays_.at(u, v).x(), rays_.at(u, v).y(), 1);
        const bool meets = Meets(mesh, pose_.translation(), pose_.linear() * ray, view.depth(u, v));
        (meets ? hidden : seen) += 1;
        (meets ? u_hidden : u_seen) += u;
        (meets ? v_hidden : v_seen) += v;
      }
      EXPECT_NEAR(hidden, share * (hidden + seen), 0.05 * (hidden + seen));
      ASSERT_GT(hidden, 0);
      ASSERT_GT(seen, 0);
      // In a levelled picture; v points down.
      const double right = u_hidden / hidden - u_seen / seen;
      const double down = v_hidden / hidden - v_seen / seen;
      if (edge == BoardEdge::kLeft) {
        EXPECT_LT(right, -3);
      }
      if (edge == BoardEdge::kRight) {
        EXPECT_GT(right, 3);
      }
      if (edge == BoardEdge::kBelow) {
        EXPECT_GT(down, 3);
      }
    }
  }
}

TEST_F(Boards, ASensorThatSeesNoStructureHasNone) {
  SceneMesh mesh;
  AppendBoard(structure_, rays_, LookAt({1.5, 0.5, 1.2}, {3, 0.5, 3}, 0), 0.5, BoardEdge::kLeft,
              &mesh);
  EXPECT_TRUE(mesh.faces.empty());
  EXPECT_TRUE(mesh.objects.empty());
}

}  // namespace
}  // namespace volalign::boards_test
