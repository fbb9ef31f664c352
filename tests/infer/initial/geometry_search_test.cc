#include "infer/initial/geometry_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "infer/initial/box_fit.h"
#include "tests/core/base/long_tests.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::geometry_search_test {
namespace {

using namespace testing_infer;

TEST(FindPosesByGeometry, TheFloorDecidesBetweenThePapersStackAndItUpsideDown) {
  const Structure structure = PaperStructure();
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(45.0 * i, 2.0 + 0.2 * i, 0.3 + 0.05 * (i % 3));
    ExpectChosen(Choose(See(structure, truth), structure), truth);
  }
}

TEST(FindPosesByGeometry, AnyStackOfBoxes) {
  for (std::uint64_t seed = 0; seed < Rounds(3, 6); ++seed) {
    const Structure structure = RandomStack(seed);
    const Eigen::Vector3d middle(0, structure.Height() / 2, 0);
    for (int i = 0; i < 3; ++i) {
      SCOPED_TRACE(std::to_string(seed) + ": " + std::to_string(i));
      const Pose truth = RingPose(20.0 + 90 * i, 1.8 + 0.4 * i, 1.2, 90, middle);
      ExpectChosen(Choose(See(structure, truth), structure), truth);
    }
  }
}

TEST(FindPosesByGeometry, ASensorMayBeRolledByAnyAngle) {
  const Structure structure = PaperStructure();
  for (const double roll : {0.0, 37.0, 180.0, 250.0}) {
    SCOPED_TRACE(roll);
    const Pose truth = RingPose(70, 2.3, 0.5, roll);
    ExpectChosen(Choose(See(structure, truth), structure), truth);
  }
}

TEST(FindPosesByGeometry, WithoutAFloorEveryPoseThatTheViewAllows) {
  const Structure structure = PaperStructure();
  // From where sides that face in three directions are seen.
  for (const double phi : {35.0, 215.0}) {
    SCOPED_TRACE(phi);
    const Pose truth = RingPose(phi, 2.2, 0.4);
    const SensorView view = See(structure, truth, {false, 0});
    EXPECT_TRUE(Contains(Find(view, structure), truth));
    EXPECT_TRUE(Choose(view, structure).ambiguous());
  }
}

// A view that shows more of the stack at a pose that only looks alike was given no pose: that one
// ranks first, has not the shape by little, and took the right one with it.
TEST(FindPosesByGeometry, APoseThatShowsMoreTakesTheRightOneNotWithIt) {
  const Structure structure = PaperStructure();
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(structure);
  int cases = 0;
  for (int i = 0; i < 50 && cases < 8; ++i) {
    const Pose truth = RingPose(7.0 * i, 1.3 + 0.2 * (i % 5), 0.2 + 0.1 * (i % 4), 90,
                                {0.15 * (i % 3) - 0.15, 0.3 * (i % 7) - 0.9, 0});
    const SensorView view = See(structure, truth);
    const SensorSurface surface = LookAround(view, structure).surface;
    const std::vector<OrientedPoint> points = PointsOf(surface);
    const auto fitted = [&](const Pose& pose) {
      return MeasureShape(surface, structure,
                          FitToBoxes(points, structure, {4, 1500, 0.05, 0.03, false}, pose));
    };
    const ViewFit right = fitted(truth);
    if (!HasShape(right)) continue;
    const bool outdone =
        std::any_of(symmetries.begin(), symmetries.end(), [&](const StructureSymmetry& symmetry) {
          const ViewFit other = fitted(symmetry.motion * truth);
          return other.explained > right.explained && !HasShape(other);
        });
    if (!outdone) continue;
    ++cases;
    SCOPED_TRACE(i);
    EXPECT_TRUE(Contains(Find(view, structure), truth));
  }
  EXPECT_EQ(cases, 8);
}

// One family of upright planes tells nothing of a turn about their normal. What reaches under the
// structure contradicts a pose, unless it is seen to stand on a table.
TEST(FindPosesByGeometry, FromTheFrontWithoutAFloor) {
  const Structure structure = PaperStructure();
  // The front and a side, else all four.
  for (std::uint64_t i = 0; i < Rounds(2, 4); ++i) {
    for (const double wall : {0.0, 3.5}) {
      SCOPED_TRACE(std::to_string(i) + (wall > 0 ? " in a room" : ""));
      const Pose truth = RingPose(90.0 * static_cast<double>(i), 2.2, 0.2);
      const SensorView view = See(structure, truth, {false, wall});
      EXPECT_EQ(Contains(Find(view, structure), truth), wall == 0);
      if (wall == 0) {
        EXPECT_TRUE(Choose(view, structure).ambiguous());
      }
    }
  }
}

// With and without the room's floor, 0.7 m under the table.
TEST(FindPosesByGeometry, OnATable) {
  const Structure stack =
      Structure::FromBoxes("stack", {Standing("low", {0.5, 0.3, 0.35}, {0, 0, 0}),
                                     Standing("high", {0.3, 0.4, 0.3}, {0.1, 0.3, 0.02}, 25)});
  std::vector<Box> with_table = stack.boxes();
  with_table.push_back(Standing("table", {1.2, 0.7, 0.9}, {0.2, -0.7, 0.1}));
  const Structure seen = Structure::FromBoxes("stack on a table", with_table);
  const Pose truth = RingPose(60, 2.0, 0.9, 90, {0, 0.2, 0});
  for (const bool floor : {true, false}) {
    SCOPED_TRACE(floor);
    ExpectChosen(Choose(See(seen, truth, {floor, 3.5}), stack), truth);
  }
}

// Small boxes on a table, one before the other: their faces lie in one plane by its tolerances, but
// not side by side, and together they are larger than any of the structure.
TEST(FindPosesByGeometry, SmallBoxesBesideAnotherInOnePlane) {
  const Structure stack =
      Structure::FromBoxes("stack", {Standing("large", {0.24, 0.23, 0.16}, {0, 0, 0}),
                                     Standing("small", {0.14, 0.19, 0.06}, {0.2, 0, 0.35}, 40)});
  std::vector<Box> seen = stack.boxes();
  seen.push_back(Standing("other", {0.2, 0.23, 0.1}, {0.32, 0, -0.03}));
  seen.push_back(Standing("table", {1.4, 0.7, 1.0}, {0.1, -0.7, 0.1}));
  const Pose truth = LookAt({0.3, 0.6, 1.4}, {0.1, 0.05, 0.1}, 0);
  ExpectChosen(Choose(See(Structure::FromBoxes("seen", seen), truth, {false, 2.5}), stack), truth);
}

TEST(FindPosesByGeometry, NothingInARoomWithoutTheStack) {
  const Structure structure = PaperStructure();
  Structure elsewhere =
      structure.Displaced(std::vector<Pose>(4, Pose(Eigen::Translation3d(100, 0, 0))));
  for (const bool floor : {true, false}) {
    for (int i = 0; i < 2; ++i) {
      SCOPED_TRACE(i);
      EXPECT_TRUE(Find(See(elsewhere, RingPose(50.0 * i), {floor, 2.5}), structure).empty());
    }
  }
}

TEST(FindPosesByGeometry, NothingBeforeAWall) {
  const Structure structure = PaperStructure();
  const SensorView wall = MakeSensorView(DepthImage(320, 288, 1.5f), Kinect());
  EXPECT_TRUE(Find(wall, structure).empty());
  EXPECT_TRUE(Find(MakeSensorView(DepthImage(320, 288, 0.0f), Kinect()), structure).empty());
}

TEST(FindPosesByGeometry, NothingAmongOtherBoxes) {
  const Structure others =
      Structure::FromBoxes("others", {Standing("a", {0.7, 0.5, 0.5}, {0.3, -0.81, 0.4}, 20),
                                      Standing("b", {0.4, 1.1, 0.4}, {-0.5, -0.81, -0.2}, 70),
                                      Standing("c", {0.5, 0.3, 0.8}, {0.3, -0.31, 0.4}, 35)});
  for (int i = 0; i < 3; ++i) {
    SCOPED_TRACE(i);
    EXPECT_TRUE(Find(See(others, RingPose(120.0 * i, 2.3)), PaperStructure()).empty());
  }
}

TEST(FindPosesByGeometry, ASymmetricStackIsAmbiguousOnAFloor) {
  const std::vector<Structure> stacks = {
      Structure::FromBoxes("one", {Standing("one", {0.5, 0.4, 0.3}, {0, 0, 0})}),
      Structure::FromBoxes("two", {Standing("a", {0.4, 0.35, 0.3}, {-0.2, 0, 0}),
                                   Standing("b", {0.4, 0.35, 0.3}, {0.2, 0, 0})}),
      Structure::FromBoxes("column", {Standing("a", {0.4, 0.4, 0.4}, {0, 0, 0}),
                                      Standing("b", {0.4, 0.4, 0.4}, {0, 0.4, 0})})};
  for (const Structure& structure : stacks) {
    SCOPED_TRACE(structure.name());
    const Pose truth = RingPose(35, 1.8, 0.9, 90, {0, 0.2, 0});
    const SensorView view = See(structure, truth);
    EXPECT_TRUE(Contains(Find(view, structure), truth));
    EXPECT_TRUE(Choose(view, structure).ambiguous());
  }
}

}  // namespace
}  // namespace volalign::geometry_search_test
