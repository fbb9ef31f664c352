#include "infer/initial/stack_search.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/visibility.h"
#include "infer/initial/stack_votes.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::stack_search_test {
namespace {

using testing_infer::Standing;

/// Two boxes that look the same from no two sides.
Structure Stack() {
  return Structure::FromBoxes("stack", {Standing("low", {0.6, 0.3, 0.4}, {0.2, 0.1, -0.1}),
                                        Standing("high", {0.3, 0.4, 0.25}, {0.33, 0.4, -0.15})});
}

/// All of its surface as a sensor would measure it that sees it from all around.
std::vector<OrientedPoint> SurfaceOf(const Structure& structure, const Pose& pose) {
  constexpr double kSpacing = 0.02;
  std::vector<OrientedPoint> points;
  for (const Eigen::Vector3d& p : SampleExposedSurface(structure, kSpacing)) {
    const auto side = static_cast<std::size_t>(DistanceToSurface(structure, p).side);
    points.push_back({pose.inverse() * p,
                      pose.linear().transpose() * structure.sides()[side].normal,
                      kSpacing * kSpacing});
  }
  return points;
}

TEST(RoomFromSensor, IsATurnThatBringsUpToY) {
  for (const Eigen::Vector3d& direction :
       {Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, -1, 0), Eigen::Vector3d(1, 0, 0),
        Eigen::Vector3d(0.3, -0.5, 0.7)}) {
    const Eigen::Vector3d up = direction.normalized();
    const Eigen::Matrix3d room = RoomFromSensor(up);
    EXPECT_TRUE((room * room.transpose()).isIdentity(1e-12));
    EXPECT_NEAR(room.determinant(), 1, 1e-12);
    EXPECT_TRUE((room * up).isApprox(Eigen::Vector3d::UnitY(), 1e-12));
  }
}

/// A sensor 2 m away, tilted and rolled.
Pose Somewhere(double phi_deg) {
  return testing_infer::RingPose(phi_deg, 2.1, 1.2, 35, {0.3, 0.3, 0});
}

/// The way in which the stack stands at a pose.
StandingGuess GuessOf(const Structure& structure, const Pose& truth) {
  StandingGuess guess;
  guess.up = truth.linear().transpose() * Eigen::Vector3d::UnitY();
  guess.feet = {structure.FloorHeight() - truth.translation().y()};
  return guess;
}

TEST(SearchStack, FindsItWhereItStands) {
  const Structure structure = Stack();
  const StackOutline outline = MakeStackOutline(structure);
  for (const double phi : {10.0, 100.0, 195.0, 290.0}) {
    const Pose truth = Somewhere(phi);
    StandingGuess guess;
    guess.up = truth.linear().transpose() * Eigen::Vector3d::UnitY();
    // The foot as seen from the sensor: its own height less that of the structure's lowest point.
    guess.feet = {structure.FloorHeight() - truth.translation().y()};
    const auto found = SearchStack(SurfaceOf(structure, truth), outline, {guess}, 4);
    ASSERT_EQ(found.size(), 1u);
    ASSERT_GE(found[0].size(), 1u);
    const Pose& best = found[0][0].structure_from_sensor;
    EXPECT_TRUE((best.linear() * guess.up).isApprox(Eigen::Vector3d::UnitY(), 1e-9));
    // A turn on either side of the true one; a cell, where the stack's middle comes to lie.
    const PoseError error = ComparePoses(best, truth);
    EXPECT_LT(error.rotation_deg, outline.yaw_step * 180 / M_PI) << phi;
    const Eigen::Vector3d off = best * (truth.inverse() * outline.foot) - outline.foot;
    EXPECT_LT(off.norm(), 1.5 * outline.cell) << phi;
    EXPECT_NEAR(off.y(), 0, 1e-9) << phi;
    for (std::size_t k = 1; k < found[0].size(); ++k)
      EXPECT_LE(found[0][k].votes, found[0][k - 1].votes);
    EXPECT_LE(found[0].size(), 4u);
  }
}

TEST(SearchStack, AnswersEveryGuess) {
  const Structure structure = Stack();
  const StackOutline outline = MakeStackOutline(structure);
  const Pose truth = Somewhere(60);
  StandingGuess right = GuessOf(structure, truth);
  const double foot = right.feet[0];
  right.feet = {foot - 1.5, foot};  // the second is the right one
  StandingGuess over = right;
  over.up = -right.up;
  over.feet = {-foot - structure.Height()};
  StandingGuess nowhere = right;
  nowhere.feet = {5};
  const auto found = SearchStack(SurfaceOf(structure, truth), outline, {over, nowhere, right}, 3);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_TRUE(found[1].empty()) << "nothing was measured there";
  ASSERT_FALSE(found[2].empty());
  EXPECT_LT(ComparePoses(found[2][0].structure_from_sensor, truth).rotation_deg, 4);
  // Upside down fewer cells are right.
  if (!found[0].empty()) {
    EXPECT_LT(found[0][0].votes, 0.8 * found[2][0].votes);
  }
  EXPECT_TRUE(SearchStack({}, outline, {}, 3).empty());
}

/// The turn of the room frame from the structure's, rad.
double YawOf(const Pose& structure_from_sensor, const Eigen::Vector3d& up) {
  const Eigen::Matrix3d turn = RoomFromSensor(up) * structure_from_sensor.linear().transpose();
  return std::atan2(turn(0, 2), turn(0, 0));
}

// Also where it stands between the last turn and the first, which are neighbours.
TEST(SearchStack, NoTwoCandidatesAreOne) {
  const Structure structure = Stack();
  const StackOutline outline = MakeStackOutline(structure);
  StandingGuess guess;
  guess.up = Somewhere(60).linear().transpose() * Eigen::Vector3d::UnitY();
  const double yaw = YawOf(Somewhere(60), guess.up);
  for (const double wanted : {-0.3 * outline.yaw_step, 1.0}) {
    const Pose turn(Eigen::AngleAxisd(yaw - wanted, Eigen::Vector3d::UnitY()));
    const Pose truth = turn * Somewhere(60);
    ASSERT_NEAR(YawOf(truth, guess.up), wanted, 1e-9);
    guess.feet = {structure.FloorHeight() - truth.translation().y()};
    const auto found = SearchStack(SurfaceOf(structure, truth), outline, {guess}, 50);
    ASSERT_FALSE(found[0].empty());
    EXPECT_LT(ComparePoses(found[0][0].structure_from_sensor, truth).rotation_deg, 4);
    for (std::size_t k = 0; k < found[0].size(); ++k) {
      EXPECT_GE(found[0][k].votes, kLeastVotes * found[0][0].votes);
      for (std::size_t j = 0; j < k; ++j) {
        const Pose& a = found[0][j].structure_from_sensor;
        const Pose& b = found[0][k].structure_from_sensor;
        const double apart = (a.inverse() * outline.foot - b.inverse() * outline.foot).norm();
        const double turned = ComparePoses(a, b).rotation_deg * M_PI / 180;
        EXPECT_TRUE(apart > 2 * outline.cell || turned > 2 * outline.yaw_step)
            << wanted << ": " << j << " and " << k;
      }
    }
  }
}

TEST(SearchStack, GivesAsManyAsAreAskedFor) {
  const Structure structure = Stack();
  const StackOutline outline = MakeStackOutline(structure);
  const Pose truth = Somewhere(60), beside = Eigen::Translation3d(1.1, 0, 0.7) * truth;
  std::vector<OrientedPoint> points = SurfaceOf(structure, truth);
  for (const OrientedPoint& point : SurfaceOf(structure, beside)) points.push_back(point);
  StandingGuess guess;
  guess.up = truth.linear().transpose() * Eigen::Vector3d::UnitY();
  guess.feet = {structure.FloorHeight() - truth.translation().y()};
  EXPECT_GE(SearchStack(points, outline, {guess}, 5)[0].size(), 2u) << "it stands there twice";
  EXPECT_EQ(SearchStack(points, outline, {guess}, 1)[0].size(), 1u);
}

// Which of two heights is the floor's is not for the votes to say.
TEST(SearchStack, FindsItOnEveryFoot) {
  const Structure structure = Stack();
  const StackOutline outline = MakeStackOutline(structure);
  const Pose truth = Somewhere(60);
  StandingGuess guess = GuessOf(structure, truth);
  const double foot = guess.feet[0];
  guess.feet = {foot - 0.03, foot};
  const auto found = SearchStack(SurfaceOf(structure, truth), outline, {guess}, 20);
  for (const double high : guess.feet) {
    const bool is_found =
        std::any_of(found[0].begin(), found[0].end(), [&](const StackCandidate& candidate) {
          const Pose& pose = candidate.structure_from_sensor;
          const Eigen::Vector3d at = RoomFromSensor(guess.up) * (pose.inverse() * outline.foot);
          return std::abs(at.y() - high) < 1e-9 && ComparePoses(pose, truth).rotation_deg < 4;
        });
    EXPECT_TRUE(is_found) << high;
  }
}

// Only the turns that are asked for are tried, each on its own.
TEST(SearchStack, KeepsToTheTurnsOfTheGuess) {
  const Structure structure = Stack();
  const StackOutline outline = MakeStackOutline(structure);
  const Pose truth = Somewhere(200);
  StandingGuess guess;
  guess.up = truth.linear().transpose() * Eigen::Vector3d::UnitY();
  guess.feet = {structure.FloorHeight() - truth.translation().y()};
  const double yaw = YawOf(truth, guess.up);
  guess.yaws = {yaw + 1.0, yaw, yaw + 0.05};
  const auto found = SearchStack(SurfaceOf(structure, truth), outline, {guess}, 10);
  ASSERT_FALSE(found[0].empty());
  EXPECT_LT(ComparePoses(found[0][0].structure_from_sensor, truth).rotation_deg, 1e-6);
  bool turned = false;
  for (const StackCandidate& candidate : found[0]) {
    const double deg = ComparePoses(candidate.structure_from_sensor, truth).rotation_deg;
    const bool as_second = std::abs(deg - 0.05 * 180 / M_PI) < 1e-6;
    turned = turned || as_second;
    EXPECT_TRUE(deg < 1e-6 || std::abs(deg - 180 / M_PI) < 1e-6 || as_second) << deg;
  }
  EXPECT_TRUE(turned) << "in about the same place";
}

}  // namespace
}  // namespace volalign::stack_search_test
