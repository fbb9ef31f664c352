#include "infer/pose/geometry_search.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "core/random.h"
#include "infer/pose/pose_choice.h"
#include "infer/pose/pose_sources.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::AddNoise;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;
using testing_infer::Scene;

/// What a sensor at `pose` sees of a structure in a room, with noise.
SensorView See(const Structure& structure, const Pose& pose, const Scene& scene = {true, 3.5}) {
  DepthImage depth = Render(structure, Kinect(), pose, scene).depth;
  AddNoise(&depth, 0.005, 1);
  return MakeSensorView(depth, Kinect());
}

std::vector<GeometricPose> Find(const SensorView& view, const Structure& structure,
                                double table_height_m = 0) {
  return FindPosesByGeometry(view, structure, FindAliases(structure), table_height_m,
                             GeometryOptions());
}

/// The pose that geometry and the floor decide on.
PoseChoice Choose(const SensorView& view, const Structure& structure, double table_height_m = 0) {
  InitialPoseOptions options;
  options.table_height_m = table_height_m;
  return Decide(ProposeByGeometry(view, structure, FindAliases(structure), options), structure,
                PoseChoiceOptions());
}

/// Found as one of the poses, to 5 cm and 2 deg.
bool Contains(const std::vector<GeometricPose>& poses, const Pose& truth) {
  return std::any_of(poses.begin(), poses.end(), [&](const GeometricPose& pose) {
    const PoseError error = ComparePoses(pose.structure_from_sensor, truth);
    return error.translation_m < 0.05 && error.rotation_deg < 2;
  });
}

void ExpectChosen(const PoseChoice& choice, const Pose& truth) {
  ASSERT_TRUE(choice.found);
  EXPECT_FALSE(choice.ambiguous);
  const PoseError error = ComparePoses(choice.best.structure_from_sensor, truth);
  EXPECT_LT(error.translation_m, 0.05);
  EXPECT_LT(error.rotation_deg, 2);
}

/// A box that stands with its foot at y, m; turned about the vertical.
Box Standing(const std::string& name, const Eigen::Vector3d& size, const Eigen::Vector3d& foot,
             double yaw_deg = 0) {
  Box box{name, size, Pose::Identity()};
  box.structure_from_box.translation() = foot + Eigen::Vector3d(0, size.y() / 2, 0);
  box.structure_from_box.linear() =
      Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()).toRotationMatrix();
  return box;
}

/// Two to five boxes of a random size, one on the other, each turned as it likes.
Structure RandomStack(std::uint64_t seed) {
  RandomStream random(seed, 0, "stack");
  const int count = 2 + random.Below(4);
  std::vector<Box> boxes;
  Eigen::Vector3d foot(0, 0, 0);
  for (int k = 0; k < count; ++k) {
    const Eigen::Vector3d size(random.Uniform(0.25, 0.6), random.Uniform(0.2, 0.45),
                               random.Uniform(0.25, 0.6));
    const double yaw = random.Below(2) == 0 ? 0 : random.Uniform(-45, 45);
    boxes.push_back(Standing("box" + std::to_string(k), size, foot, yaw));
    foot += Eigen::Vector3d(random.Uniform(-0.12, 0.12), size.y(), random.Uniform(-0.12, 0.12));
  }
  return Structure::FromBoxes("stack", boxes);
}

TEST(FindPosesByGeometry, TheFloorDecidesBetweenThePapersStackAndItUpsideDown) {
  const Structure structure = PaperStructure();
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    const Pose truth = RingPose(45.0 * i, 2.0 + 0.2 * i, 0.3 + 0.05 * (i % 3));
    ExpectChosen(Choose(See(structure, truth), structure), truth);
  }
}

TEST(FindPosesByGeometry, AnyStackOfBoxes) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
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
    EXPECT_TRUE(Choose(view, structure).ambiguous);
  }
}

// One family of upright planes tells nothing of a turn about their normal. The room's walls reach
// under the structure, as round a table: that speaks for no pose.
TEST(FindPosesByGeometry, FromTheFrontWithoutAFloor) {
  const Structure structure = PaperStructure();
  for (int i = 0; i < 4; ++i) {
    for (const double wall : {0.0, 3.5}) {
      SCOPED_TRACE(std::to_string(i) + (wall > 0 ? " in a room" : ""));
      const Pose truth = RingPose(90.0 * i, 2.2, 0.2);
      const SensorView view = See(structure, truth, {false, wall});
      EXPECT_TRUE(Contains(Find(view, structure), truth));
      EXPECT_TRUE(Choose(view, structure).ambiguous);
    }
  }
}

TEST(FindPosesByGeometry, OnATableOfKnownAndUnknownHeight) {
  const Structure stack =
      Structure::FromBoxes("stack", {Standing("low", {0.5, 0.3, 0.35}, {0, 0, 0}),
                                     Standing("high", {0.3, 0.4, 0.3}, {0.1, 0.3, 0.02}, 25)});
  std::vector<Box> with_table = stack.boxes();
  with_table.push_back(Standing("table", {1.2, 0.7, 0.9}, {0.2, -0.7, 0.1}));
  const Structure seen = Structure::FromBoxes("stack on a table", with_table);
  const Pose truth = RingPose(60, 2.0, 0.9, 90, {0, 0.2, 0});
  const SensorView view = See(seen, truth);
  ExpectChosen(Choose(view, stack, 0.7), truth);
  EXPECT_TRUE(Contains(Find(view, stack, -1), truth));
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
    EXPECT_TRUE(Choose(view, structure).ambiguous);
  }
}

}  // namespace
}  // namespace volalign
