#include "infer/checks/free_space.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::seen_through_test {
namespace {

using namespace testing_infer;

constexpr double kRefuting = 100;
/// What two sensors alone see of each other's surroundings is little.
constexpr double kDoubtful = 1;

/// Sensors round a row of cartons, in a room whose cupboard and bench are no part of the structure.
struct Room {
  Rig rig;
  std::vector<SensorView> views;
  std::vector<Pose> poses;

  explicit Room(int sensors) : rig(RowInARoom(80, sensors)) {
    for (const SensorFrame& frame : rig.frames) {
      views.push_back(MakeSensorView(frame.depth, frame.intrinsics));
      poses.push_back(*frame.ground_truth);
    }
  }
  void TurnAboutTheVertical(std::size_t i) {
    poses[i] = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()) * poses[i];
  }
  std::vector<std::optional<FreeSpaceViolation>> Find(double refuting_odds = kRefuting) const {
    std::vector<const SensorView*> all;
    for (const SensorView& view : views) all.push_back(&view);
    return FindFreeSpaceViolations(all, poses, rig.structure, refuting_odds, 1);
  }
};

TEST(FindFreeSpaceViolations, NothingOfSensorsThatStandWhereTheyDo) {
  for (const int sensors : {1, 2, 5}) {
    for (const auto& found : Room(sensors).Find()) EXPECT_FALSE(found.has_value()) << sensors;
  }
}

TEST(FindFreeSpaceViolations, OfTwoEitherMayBeTheWrongOne) {
  Room room(2);
  room.TurnAboutTheVertical(1);
  const auto found = room.Find(kDoubtful);
  for (const std::size_t i : {0, 1}) {
    ASSERT_TRUE(found[i].has_value());
    EXPECT_EQ(found[i]->other, 1 - i);
    EXPECT_LT(found[i]->log_odds, 0);
    EXPECT_GT(found[i]->share, 0.01);
    EXPECT_FALSE(room.Find(std::exp(-found[i]->log_odds) * 1.01)[i].has_value());
  }
  // Turned together, they agree.
  room.TurnAboutTheVertical(0);
  EXPECT_FALSE(room.Find(kDoubtful)[0].has_value());
}

TEST(FindFreeSpaceViolations, OfSeveralTheWrongOneAlone) {
  Room room(5);
  room.TurnAboutTheVertical(3);
  const auto found = room.Find();
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(found[i].has_value(), i == 3) << i;
}

// The third sees nothing but the row.
TEST(FindFreeSpaceViolations, OfTwoThatNoOtherTellsApartEitherMayBeTheWrongOne) {
  Room room(2);
  room.TurnAboutTheVertical(1);
  room.views.push_back(room.views[0]);
  room.poses.push_back(room.poses[0]);
  DepthImage& depth = room.views[2].depth;
  const ExpectedView seen = CastView(room.rig.structure, room.views[2].rays, room.poses[2]);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!(seen.depth[i] > 0)) depth[i] = 0;
  }
  const auto found = room.Find(kDoubtful);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found[i].has_value(), i < 2) << i;
}

TEST(FindFreeSpaceViolations, ASensorWithoutAPoseTakesNoPart) {
  Room room(3);
  room.TurnAboutTheVertical(2);
  const auto found = FindFreeSpaceViolations({&room.views[0], &room.views[1], nullptr}, room.poses,
                                             room.rig.structure, kRefuting, 1);
  for (const auto& each : found) EXPECT_FALSE(each.has_value());
}

}  // namespace
}  // namespace volalign::seen_through_test
