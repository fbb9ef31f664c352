#include "infer/initial/oriented_points.h"

#include <gtest/gtest.h>

#include "core/geometry/visibility.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::oriented_points_test {
namespace {

using testing_infer::RingPose;
using testing_infer::See;
using testing_infer::Standing;

/// Of the rays that hit this box: those, and of them the marked ones.
std::pair<int, int> CountMarked(const SensorSurface& surface, const Structure& structure, int box,
                                const Pose& pose) {
  std::pair<int, int> counts;
  const ExpectedView seen = CastView(structure, surface.view.rays, pose);
  for (int v = 0; v < surface.view.height(); ++v) {
    for (int u = 0; u < surface.view.width(); ++u) {
      const int label = seen.labels(u, v);
      if (label == 0 || structure.SideOfLabel(label).box != box) continue;
      if (!(surface.normals(u, v).squaredNorm() > 0)) continue;
      ++counts.first;
      counts.second += surface.room(u, v);
    }
  }
  return counts;
}

// A side of a box that lies in one plane with a wall is marked as the room's only where they touch.
TEST(MarkRoom, LargePartsOfLargePlanes) {
  for (const double gap : {0.0, 1.0}) {
    SCOPED_TRACE(gap);
    const Structure scene =
        Structure::FromBoxes("scene", {Standing("wall", {1.6, 1.6, 0.2}, {-0.8 - gap, -0.4, 0}),
                                       Standing("box", {0.4, 0.4, 0.2}, {0.2, 0.1, 0})});
    const Pose pose = RingPose(90, 2.6, 0.4, 0, {-0.3, 0.3, 0});
    SensorSurface surface = MakeSensorSurface(See(scene, pose, {false, 0}), 10000);
    MarkRoom(FindRoomPlanes(PointsOf(surface), 10, surface.view.errors), 0.5, &surface);
    const auto [wall, marked_wall] = CountMarked(surface, scene, 0, pose);
    const auto [box, marked_box] = CountMarked(surface, scene, 1, pose);
    ASSERT_GT(wall, 500);
    ASSERT_GT(box, 100);
    EXPECT_GT(marked_wall, 0.9 * wall);
    EXPECT_EQ(marked_box > 0.5 * box, gap == 0);
    EXPECT_EQ(marked_box == 0, gap > 0);
  }
}

}  // namespace
}  // namespace volalign::oriented_points_test
