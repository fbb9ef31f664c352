#include "infer/pose/floor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

/// A sensor 1.2 m above the floor that looks straight down, beside a cube of 0.4 m. Every pixel has
/// the ray of the optical axis until it gets another one.
struct FromAbove {
  Structure structure =
      Structure::FromBoxes("cube", {Box::FromMinMax("c", {0, 0, 0}, {0.4, 0.4, 0.4})});
  SensorView view;
  Pose pose = Pose::Identity();

  FromAbove() {
    view.depth = DepthImage(12, 4, 5.0f);  // clearly under the floor
    view.rays = {12, 4, std::vector<Eigen::Vector2f>(48, Eigen::Vector2f::Zero())};
    pose.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;  // z down, y towards +z
    pose.translation() = Eigen::Vector3d(-0.5, 1.2, 0.2);
  }
};

TEST(FindFloor, CountsEverySecondPixelOfEverySecondRow) {
  FromAbove scene;
  // The tolerance at 1.2 m is 3 cm + 2 % of 1.2 m = 5.4 cm.
  const float depths[] = {1.2f, 1.24f, 1.16f, 1.3f, 0.6f, 0.0f};
  for (int i = 0; i < 6; ++i) scene.view.depth(1 + 2 * i, 1) = depths[i];
  // Second row: on the floor 2 cm and 10 cm beside the cube, under the floor by 18 cm (over three
  // tolerances), by 15 cm (under), on the cube, and without depth.
  const float depths_2[] = {1.2f, 1.2f, 1.38f, 1.35f, 0.8f, 0.0f};
  const double x[] = {-0.02, -0.1, -0.5, -0.5, 0.2, 0};
  for (std::size_t i = 0; i < 6; ++i) {
    scene.view.depth(1 + 2 * static_cast<int>(i), 3) = depths_2[i];
    if (depths_2[i] > 0) {
      scene.view.rays.rays[3 * 12 + 1 + 2 * i].x() = static_cast<float>((x[i] + 0.5) / depths_2[i]);
    }
  }
  const FloorEvidence floor = FindFloor(scene.view, scene.structure, scene.pose);
  EXPECT_EQ(floor.pixels, 10);
  EXPECT_EQ(floor.on_floor, 4);  // the first three, and the one 10 cm beside the cube
  EXPECT_EQ(floor.below, 1);
  EXPECT_EQ(floor.balance(), 2);
  EXPECT_DOUBLE_EQ(floor.share(), 0.2);
}

TEST(FindFloor, NothingMeasuredSaysNothing) {
  FromAbove scene;
  scene.view.depth = DepthImage(12, 4, 0.0f);
  const FloorEvidence floor = FindFloor(scene.view, scene.structure, scene.pose);
  EXPECT_EQ(floor.pixels, 0);
  EXPECT_EQ(floor.share(), 0);
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
  for (int v = 1; v < view.height(); v += 2) {
    for (int u = 1; u < view.width(); u += 2) {
      pixels += view.depth(u, v) > 0 ? 1 : 0;
      if (view.depth(u, v) > 0 && !(alone.depth(u, v) > 0) &&
          Distance(structure, pose * view.Point(u, v)) > 0.03)
        ++expected;
    }
  }
  const FloorEvidence floor = FindFloor(view, structure, pose);
  EXPECT_EQ(floor.pixels, pixels);
  // Points of the lowest centimetres of the stack lie within 3 cm of it and do not count.
  EXPECT_EQ(floor.on_floor, expected);
  EXPECT_EQ(floor.below, 0);
  ASSERT_GT(expected, 1000);
}

TEST(FloorMargin, IsTheLeastDifferenceToAnAlias) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const SensorView view = MakeSensorView(Render(structure, Kinect(), pose).depth, Kinect());
  EXPECT_EQ(FloorMargin(view, structure, {}, pose), 1);
  // Two motions by hand: upside down about the stack's middle, which is at the origin's height, and
  // 0.4 m higher.
  StructureAlias over, higher;
  over.motion.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  higher.motion.translation().y() = 0.4;
  const double own = FindFloor(view, structure, pose).share();
  const double upside_down = FindFloor(view, structure, over.motion * pose).share();
  const double raised = FindFloor(view, structure, higher.motion * pose).share();
  EXPECT_LT(upside_down, own);
  EXPECT_LT(raised, own);
  EXPECT_DOUBLE_EQ(FloorMargin(view, structure, {over}, pose), own - upside_down);
  EXPECT_DOUBLE_EQ(FloorMargin(view, structure, {over, higher}, pose),
                   own - std::max(upside_down, raised));
  // At the raised pose the true one is an alias that the floor speaks for.
  StructureAlias lower;
  lower.motion.translation().y() = -0.4;
  EXPECT_LT(FloorMargin(view, structure, {lower}, higher.motion * pose), -0.05);
}

}  // namespace
}  // namespace volalign
