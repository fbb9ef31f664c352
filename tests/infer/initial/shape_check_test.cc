#include "infer/initial/shape_check.h"

#include <gtest/gtest.h>

#include "infer/initial/floor.h"
#include "infer/initial/geometry_search.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::shape_check_test {
namespace {

using testing_infer::RingPose;
using testing_infer::See;
using testing_infer::Standing;

/// The upper box is turned by `yaw_deg`.
Structure Stack(double yaw_deg = 0, double height = 0) {
  return Structure::FromBoxes(
      "stack", {Standing("low", {0.5, 0.35, 0.4}, {0, height, 0}),
                Standing("high", {0.35, 0.4, 0.3}, {0.05, height + 0.35, 0}, yaw_deg)});
}

const Pose kTruth = RingPose(40, 1.9, 0.9, 90, {0, 0.35, 0});

TEST(ShapeLogOdds, AtTheTruePoseOnly) {
  const SensorView view = See(Stack(), kTruth);
  EXPECT_TRUE(ShapeLogOdds(view, Stack(), kTruth).has_value());
  const Pose aside = Eigen::Translation3d(-0.08, 0, -0.05) * kTruth;
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), aside).has_value());
}

// Within the tolerance of a first look, the sides of a box that is turned lie where they should.
TEST(ShapeLogOdds, NotWhereASideFacesElsewhere) {
  const SensorView view = See(Stack(16), kTruth);
  EXPECT_TRUE(HasShape(MeasureShape(PrepareSurface(view, Stack()), Stack(), kTruth)));
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), kTruth).has_value());
  EXPECT_TRUE(ShapeLogOdds(See(Stack(5), kTruth), Stack(), kTruth).has_value());
}

// The upper box is 20 cm narrower than described: so much of it is seen through.
TEST(ShapeLogOdds, NotWhereMuchIsMissing) {
  const Structure narrow =
      Structure::FromBoxes("narrow", {Standing("low", {0.5, 0.35, 0.4}, {0, 0, 0}),
                                      Standing("high", {0.15, 0.4, 0.3}, {0.15, 0.35, 0})});
  const SensorView view = See(narrow, kTruth);
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), kTruth).has_value());
}

// The stack is looked for as it would lie on its side in mid-air, with the floor of the room beside
// it: much is measured where there would be ground.
TEST(FloorFit, FloatsWhereTheRoomReachesUnderTheStack) {
  const SensorView view = See(Stack(), kTruth);
  EXPECT_FALSE(FindFloor(view, Stack(), kTruth).Floats());
  const Pose lying(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX()));
  EXPECT_TRUE(FindFloor(view, Stack(), lying * kTruth).Floats());
  EXPECT_FALSE(ShapeLogOdds(view, Stack(), lying * kTruth).has_value());
}

}  // namespace
}  // namespace volalign::shape_check_test
