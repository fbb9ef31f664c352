#include "infer/initial/floor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::floor_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

Structure Cube() {
  return Structure::FromBoxes("cube", {Box::FromMinMax("c", {0, 0, 0}, {0.4, 0.4, 0.4})});
}

/// Seven by seven pixels, 12.5 mm apart at 1 m, of a sensor 1.2 m above the floor, over `x`, that
/// looks straight down beside (or on) the cube: everything at one depth.
SensorView FromAbove(float depth) {
  SensorView view;
  view.depth = DepthImage(7, 7, depth);
  view.rays = {7, 7, {}};
  view.ray_areas = Image<float>(7, 7, 0.0125f * 0.0125f);
  for (int v = 0; v < 7; ++v) {
    for (int u = 0; u < 7; ++u) view.rays.rays.emplace_back(0.0125f * (u - 3), 0.0125f * (v - 3));
  }
  return view;
}

Pose Above(double x) {
  Pose pose = Pose::Identity();
  pose.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;  // z down, y towards +z
  pose.translation() = Eigen::Vector3d(x, 1.2, 0.2);
  return pose;
}

TEST(FindFloor, CountsPixels) {
  struct Case {
    float depth;
    double x;
    int on_floor, below;
  };
  // The tolerance at 1.2 m is 3 cm + 2 % of 1.2 m = 5.4 cm; clearly below is over three of them.
  const Case cases[] = {{1.2f, -0.5, 49, 0}, {1.24f, -0.5, 49, 0}, {1.16f, -0.5, 49, 0},
                        {1.3f, -0.5, 0, 0},  {0.6f, -0.5, 0, 0},   {1.38f, -0.5, 0, 49},
                        {1.35f, -0.5, 0, 0}, {1.2f, -0.1, 49, 0},  {1.2f, 0.02, 0, 0},
                        {0.8f, 0.2, 0, 0}};
  for (const Case& c : cases) {
    const FloorFit floor = FindFloor(FromAbove(c.depth), Cube(), Above(c.x));
    EXPECT_EQ(floor.pixels, 49);
    EXPECT_EQ(floor.on_floor, c.on_floor) << c.depth << " m at " << c.x;
    EXPECT_EQ(floor.below, c.below) << c.depth << " m at " << c.x;
    EXPECT_EQ(floor.balance(), c.on_floor - 2 * c.below);
    EXPECT_EQ(floor.LogOdds() > 0, c.on_floor > 0) << c.on_floor;
  }
}

// 1.3 m under a cube that stands at a height of 0.9 m, seen from 2.5 m.
TEST(FindFloor, UnderATable) {
  Pose above = Above(-0.5);
  EXPECT_EQ(FindFloor(FromAbove(2.5f), Cube(), above).below, 0);
  // A box is less high than a table.
  EXPECT_EQ(FindFloor(FromAbove(1.45f), Cube(), above).below, 49);
  // What is upside down shows the floor's other side: a ceiling is no floor of a table.
  above.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal() * above.linear();
  above.translation().y() = -2;
  EXPECT_EQ(FindFloor(FromAbove(0.5f), Cube(), above).below, 49);
}

/// A cube on a table or in mid-air, before walls that reach down; no floor is seen.
FloorFit CubeAboveTheGround(const std::vector<Box>& with) {
  std::vector<Box> boxes = Cube().boxes();
  boxes.insert(boxes.end(), with.begin(), with.end());
  const Pose pose = LookAt({0.2, 1.0, 1.8}, {0.2, 0.1, 0.2}, 0);
  const Structure seen = Structure::FromBoxes("seen", boxes);
  const Pose origin = Pose(Eigen::Translation3d(0, 0, 0));
  const DepthImage depth = Render(seen, Kinect(), pose, {false, 2.5, origin}).depth;
  return FindFloor(MakeSensorView(depth, Kinect()), Cube(), pose);
}

TEST(FindFloor, BesideATablesEdgeIsSeenFarther) {
  const FloorFit floats = CubeAboveTheGround({});
  EXPECT_EQ(floats.beside, 0);
  EXPECT_GT(floats.passing, 0);
  EXPECT_TRUE(floats.Floats());
  EXPECT_LT(floats.balance(), 0);
  const FloorFit stands =
      CubeAboveTheGround({Box::FromMinMax("table", {-0.3, -0.05, -0.2}, {0.7, 0, 0.7})});
  EXPECT_GT(stands.below, stands.on_floor / 2) << "what lies beyond the table";
  EXPECT_GT(stands.beside, 0);
  EXPECT_FALSE(stands.Floats());
  EXPECT_GT(stands.balance(), 0);
  EXPECT_GT(stands.LogOdds(), floats.LogOdds() + std::log(100.0));
  // At an edge of the table, too.
  const FloorFit edge =
      CubeAboveTheGround({Box::FromMinMax("table", {-0.3, -0.05, -0.2}, {0.45, 0, 0.42})});
  EXPECT_GT(edge.passing, 0);
  EXPECT_FALSE(edge.Floats());
}

// An upright side that reaches down to the floor is none, and what stands alone may be anything.
TEST(FindFloor, IsLevel) {
  Pose level = Pose::Identity();  // 3 cm above the floor, looking along it
  level.linear() << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  level.translation() = Eigen::Vector3d(-1.5, 0.03, 0.2);
  EXPECT_EQ(FindFloor(FromAbove(1), Cube(), level).on_floor, 0);
  SensorView speck = FromAbove(0);
  speck.depth(3, 3) = 1.2f;
  EXPECT_EQ(FindFloor(speck, Cube(), Above(-0.5)).on_floor, 0);
}

// At a pose half a metre beside the true one the top of the cube, 0.4 m up, would be floor if the
// cube were that much higher; at the true pose it is the cube.
TEST(FindFloor, IsNotTheStructureAtAPoseThatCompetes) {
  const Pose true_pose = Above(0.2);
  Pose shifted = true_pose;
  shifted.translation() += Eigen::Vector3d(-0.8, -0.4, 0);
  const SensorView view = FromAbove(0.8f);
  EXPECT_EQ(FindFloor(view, Cube(), shifted).on_floor, 49);
  EXPECT_EQ(FindFloors(view, Cube(), {shifted, true_pose}).front().on_floor, 0);
}

TEST(FindFloor, NothingMeasuredSaysNothing) {
  const FloorFit floor = FindFloor(FromAbove(0), Cube(), Above(-0.5));
  EXPECT_EQ(floor.pixels, 0);
  EXPECT_EQ(floor.LogOdds(), 0);
}

/// Distance to the nearest side, side by side.
double Distance(const Structure& structure, const Eigen::Vector3d& p) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Side& side : structure.sides())
    nearest = std::min(nearest, (side.ClosestPoint(p) - p).norm());
  return nearest;
}

TEST(FindFloor, IsTheFloorThatWasRendered) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const auto rendered = Render(structure, Kinect(), pose);
  const auto alone = CastView(structure, ComputeRays(Kinect()), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  int expected = 0, pixels = 0;
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  for (int v = stride / 2; v < view.height(); v += stride) {
    for (int u = stride / 2; u < view.width(); u += stride) {
      pixels += view.depth(u, v) > 0 ? 1 : 0;
      if (view.depth(u, v) > 0 && !(alone.depth(u, v) > 0) &&
          Distance(structure, pose * view.Point(u, v)) > 0.03)
        ++expected;
    }
  }
  const FloorFit floor = FindFloor(view, structure, pose);
  EXPECT_EQ(floor.pixels, pixels);
  // Points of the lowest centimetres of the stack lie within 3 cm of it and do not count.
  // Along depth's edges the surface is not level.
  EXPECT_LE(floor.on_floor, expected);
  EXPECT_GT(floor.on_floor, 0.8 * expected);
  EXPECT_EQ(floor.below, 0);
  ASSERT_GT(expected, 1000);
}

TEST(FloorMargin, IsTheLeastDifferenceToAnAlias) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const SensorView view = MakeSensorView(Render(structure, Kinect(), pose).depth, Kinect());
  EXPECT_EQ(FloorMargin(view, structure, {}, pose), std::numeric_limits<double>::infinity());
  // Two motions by hand: upside down about the stack's middle, which is at the origin's height, and
  // 0.4 m higher.
  StructureAlias over, higher;
  over.motion.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  higher.motion.translation().y() = 0.4;
  const double own = FindFloor(view, structure, pose).LogOdds();
  const double upside_down = FindFloor(view, structure, over.motion * pose).LogOdds();
  const double raised = FindFloor(view, structure, higher.motion * pose).LogOdds();
  EXPECT_LT(upside_down, own);
  EXPECT_LT(raised, own);
  EXPECT_DOUBLE_EQ(FloorMargin(view, structure, {over}, pose), own - upside_down);
  EXPECT_DOUBLE_EQ(FloorMargin(view, structure, {over, higher}, pose),
                   own - std::max(upside_down, raised));
  // At the raised pose the true one is an alias that the floor speaks for.
  StructureAlias lower;
  lower.motion.translation().y() = -0.4;
  EXPECT_LT(FloorMargin(view, structure, {lower}, higher.motion * pose), -std::log(100.0));
}

}  // namespace
}  // namespace volalign::floor_test
