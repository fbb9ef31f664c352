#include "infer/initial/measured_cloud.h"

#include <gtest/gtest.h>

#include "tests/infer/view/synthetic.h"

namespace volalign::measured_cloud_test {
namespace {

using testing_infer::Coarse;

constexpr float kWall = 3;  // m

/// A cube far behind the sensors, which they do not see.
Structure Elsewhere() {
  return Structure::FromBoxes("cube", {Box::FromMinMax("c", {0, 0, -20}, {0.4, 0.4, -19.6})});
}

/// What looks straight at a wall: 20 x 10 pixels, 75 mm apart there, 1.5 m x 0.75 m.
SensorView Wall(float distance = kWall) {
  Intrinsics intrinsics = Coarse();
  intrinsics.fx = intrinsics.fy = distance / 0.075;
  return MakeSensorView(DepthImage(20, 10, distance), intrinsics);
}

/// This sensor moved along the wall.
Pose Along(double x) { return Pose(Eigen::Translation3d(x, 0, 0)); }

MeasuredCloud Cloud(const SensorView& view, const Structure& structure = Elsewhere(),
                    const std::vector<Pose>& poses = {Pose::Identity()}) {
  return {view, structure, poses};
}

// Each of n columns that are 75 mm apart, moved by whole ones: those beyond the other's border have
// none within 80 mm but the first, which is 75 mm from it.
TEST(MeasuredCloud, SharesWhatBothSee) {
  const MeasuredCloud here = Cloud(Wall()), there = Cloud(Wall());
  for (int columns = 0; columns < 24; ++columns) {
    const double expected = std::min(20, std::max(0, 21 - columns)) / 20.0;
    EXPECT_DOUBLE_EQ(here.ShareOf(there, Pose::Identity(), Along(0.075 * columns)), expected)
        << columns;
    EXPECT_DOUBLE_EQ(here.ShareOf(there, Along(-0.075 * columns), Pose::Identity()), expected)
        << columns;
  }
}

// Up to 8 cm off it is one surface.
TEST(MeasuredCloud, SharesNoOtherSurface) {
  const MeasuredCloud here = Cloud(Wall());
  EXPECT_EQ(here.ShareOf(Cloud(Wall(kWall + 0.079f)), Pose::Identity(), Pose::Identity()), 1);
  EXPECT_EQ(here.ShareOf(Cloud(Wall(kWall + 0.081f)), Pose::Identity(), Pose::Identity()), 0);
  // The other one stands nearer by as much as it measures more.
  EXPECT_EQ(
      here.ShareOf(Cloud(Wall(kWall + 1)), Pose::Identity(), Pose(Eigen::Translation3d(0, 0, -1))),
      1);
  // Both poses in a frame that is turned.
  const Pose room = testing_infer::RingPose(70);
  EXPECT_EQ(here.ShareOf(Cloud(Wall()), room, room), 1);
}

// A cube before the wall's left half, whichever of two poses it is at.
TEST(MeasuredCloud, LeavesOutTheStructureAtAllPoses) {
  SensorView view = Wall();
  for (int v = 0; v < 10; ++v) {
    for (int u = 0; u < 10; ++u) view.depth(u, v) = 2;
  }
  // Its front, 2 m away, reaches from x = -0.6 to the axis; at 2 m a pixel is 50 mm wide.
  const Structure structure =
      Structure::FromBoxes("slab", {Box::FromMinMax("s", {-0.6, -0.4, 2}, {0, 0.4, 2.1})});
  const Pose true_pose = Pose::Identity(), beside = Along(10);
  const MeasuredCloud whole = Cloud(Wall()), all = Cloud(view, structure, {beside});
  const MeasuredCloud without = Cloud(view, structure, {beside, true_pose});
  // Half of all points, which lie before the wall, are nowhere on it.
  EXPECT_DOUBLE_EQ(whole.ShareOf(all, true_pose, true_pose), 0.5);
  EXPECT_DOUBLE_EQ(whole.ShareOf(without, true_pose, true_pose), 1);
}

TEST(MeasuredCloud, SharesNothingWhereNothingIsMeasured) {
  SensorView empty = Wall();
  empty.depth = DepthImage(20, 10);
  const MeasuredCloud none = Cloud(empty), some = Cloud(Wall());
  EXPECT_EQ(none.ShareOf(some, Pose::Identity(), Pose::Identity()), 0);
  EXPECT_EQ(some.ShareOf(none, Pose::Identity(), Pose::Identity()), 0);
}

}  // namespace
}  // namespace volalign::measured_cloud_test
