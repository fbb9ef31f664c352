#include "infer/initial/standing_guesses.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/infer/initial/geometry_frames.h"

namespace volalign::standing_guesses_test {
namespace {

using testing_infer::Standing;

const Eigen::Vector3d kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

/// Of 1 m^2.
RoomPlane Plane(const Eigen::Vector3d& normal, double offset, double behind = 0.5) {
  return {normal, offset, 1, behind};
}

TEST(GuessFloors, IsWhatLittleLiesBehind) {
  const std::vector<StandingGuess> guesses =
      GuessFloors({Plane(kZ, -4, 0), Plane(kY, -1.2, 0.05), Plane(kX, -2, 0.07)}, false);
  ASSERT_EQ(guesses.size(), 2u);
  EXPECT_EQ(guesses[0].up, kZ);
  EXPECT_EQ(guesses[0].feet, std::vector<double>{-4});
  EXPECT_EQ(guesses[1].up, kY);
  EXPECT_EQ(guesses[1].feet, std::vector<double>{-1.2});
  EXPECT_TRUE(guesses[1].yaws.empty()) << "every turn";
}

TEST(GuessFloors, ATableIsWhatMoreLiesBehind) {
  const std::vector<StandingGuess> guesses =
      GuessFloors({Plane(kZ, -4, 0), Plane(kY, -1.2, 0.05), Plane(kX, -2, 0.07)}, true);
  ASSERT_EQ(guesses.size(), 1U);
  EXPECT_EQ(guesses[0].up, kX);
  EXPECT_EQ(guesses[0].feet, std::vector<double>{-2});
}

TEST(GuessFloors, AreFourAtMost) {
  std::vector<RoomPlane> planes;
  for (int k = 0; k < 6; ++k) planes.push_back(Plane(kY, -1 - k, 0));
  const std::vector<StandingGuess> guesses = GuessFloors(planes, false);
  ASSERT_EQ(guesses.size(), 4u);
  EXPECT_EQ(guesses[3].feet, std::vector<double>{-4});
  EXPECT_TRUE(GuessFloors({}, false).empty());
}

/// 0.5 m and 0.8 m high tops.
Structure Stack() {
  return Structure::FromBoxes("stack", {Standing("low", {0.6, 0.5, 0.4}, {0, 0, 0}),
                                        Standing("high", {0.3, 0.3, 0.4}, {0.1, 0.5, 0})});
}

/// Points of a level surface, `area` m^2 altogether.
void AddLevel(double height, double area, std::vector<OrientedPoint>* points) {
  constexpr int kPoints = 100;
  for (int k = 0; k < kPoints; ++k) points->push_back({{0.01 * k, height, 2}, kY, area / kPoints});
}

std::vector<StandingGuess> Guess(const std::vector<OrientedPoint>& points,
                                 const std::vector<RoomPlane>& planes,
                                 const std::vector<RoomPlane>& small,
                                 const std::vector<Eigen::Vector3d>& usual = {}) {
  const Structure structure = Stack();
  return GuessWithoutFloor(points, planes, small, structure, MakeStackOutline(structure), usual);
}

const StandingGuess* FindUp(const std::vector<StandingGuess>& guesses, const Eigen::Vector3d& up) {
  const auto found = std::find_if(guesses.begin(), guesses.end(), [&](const StandingGuess& guess) {
    return guess.up.dot(up) > std::cos(1e-6);
  });
  return found == guesses.end() ? nullptr : &*found;
}

TEST(GuessWithoutFloor, UpIsADirectionOfPlanesOrAtARightAngleToTwo) {
  // Two upright sides and nothing level: up is their cross product, either way, or one of them.
  const std::vector<StandingGuess> guesses = Guess({}, {}, {Plane(kX, -1), Plane(kZ, -2)});
  for (const Eigen::Vector3d& axis : {kX, kY, kZ}) {
    for (const double sign : {-1.0, 1.0})
      EXPECT_NE(FindUp(guesses, sign * axis), nullptr) << sign * axis.transpose();
  }
  EXPECT_EQ(guesses.size(), 6u);
  // Planes that are alike, to 15 deg, are of one direction; those 45 deg apart have no cross
  // product at a right angle to both that a stack's sides could have.
  const Eigen::Vector3d alike = Eigen::Vector3d(1, 0.2, 0).normalized();
  const Eigen::Vector3d between = Eigen::Vector3d(1, 0, 1).normalized();
  EXPECT_EQ(Guess({}, {}, {Plane(kX, -1), Plane(alike, -2), Plane(kZ, -2)}).size(), 6u);
  for (const StandingGuess& guess : Guess({}, {}, {Plane(kX, -1), Plane(between, -2)}))
    EXPECT_LT(std::abs(guess.up.dot(kY)), 0.5);
}

TEST(GuessWithoutFloor, OnePlaneAloneNeedsTheUsualDirection) {
  EXPECT_EQ(FindUp(Guess({}, {}, {Plane(kZ, -2)}), kY), nullptr);
  // 30 deg off upright: as near to the usual direction as the plane lets it.
  const Eigen::Vector3d leaning(0, std::sin(M_PI / 6), std::cos(M_PI / 6));
  const std::vector<StandingGuess> guesses = Guess({}, {}, {Plane(leaning, -2)}, {kY});
  const Eigen::Vector3d expected(0, std::cos(M_PI / 6), -std::sin(M_PI / 6));
  EXPECT_NE(FindUp(guesses, expected), nullptr);
  // 40 deg off it is no upright plane.
  const Eigen::Vector3d flat(0, std::sin(M_PI / 4.5), std::cos(M_PI / 4.5));
  const Eigen::Vector3d at_right_angle(0, std::cos(M_PI / 4.5), -std::sin(M_PI / 4.5));
  EXPECT_EQ(FindUp(Guess({}, {}, {Plane(flat, -2)}, {kY}), at_right_angle), nullptr);
}

/// Whether a side of the structure faces against `normal` at one of the turns, sensor frame.
bool SomeSideFaces(const StandingGuess& guess, const Eigen::Vector3d& normal) {
  const Eigen::Matrix3d room = RoomFromSensor(guess.up);
  const Structure stack = Stack();
  return std::any_of(guess.yaws.begin(), guess.yaws.end(), [&](double yaw) {
    const Eigen::Matrix3d room_from_structure =
        Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
    return std::any_of(stack.sides().begin(), stack.sides().end(), [&](const Side& side) {
      return (room_from_structure * side.normal).dot(room * normal) > std::cos(1e-6);
    });
  });
}

TEST(GuessWithoutFloor, TurnsBringSidesToFaceAsPlanesDo) {
  const double angle = 0.35;
  const Eigen::Vector3d one(std::cos(angle), 0, std::sin(angle));
  const std::vector<StandingGuess> guesses =
      Guess({}, {Plane(kY, -1)}, {Plane(one, -1), Plane(kZ, -2)});
  const StandingGuess* guess = FindUp(guesses, kY);
  ASSERT_NE(guess, nullptr);
  EXPECT_TRUE(SomeSideFaces(*guess, one));
  EXPECT_TRUE(SomeSideFaces(*guess, kZ));
  // Boxes have four sides: four turns for each of the two directions, which are 0.35 + 90 deg
  // apart.
  EXPECT_EQ(guess->yaws.size(), 8u);
  // The same direction again adds none.
  EXPECT_EQ(FindUp(Guess({}, {Plane(kY, -1)}, {Plane(one, -1), Plane(-one, -2)}), kY)->yaws.size(),
            4u);
}

TEST(GuessWithoutFloor, ATopIsAsHighAsASurfaceThatFacesUp) {
  std::vector<OrientedPoint> points;
  AddLevel(-0.4, 0.2, &points);
  AddLevel(0.3, 0.1, &points);
  AddLevel(0.9, 0.02, &points);  // too small beside the largest
  points.push_back({{0, -3, 2}, kX, 5});
  const std::vector<StandingGuess> guesses =
      Guess(points, {Plane(kY, -1)}, {Plane(kX, -1), Plane(kZ, -2)});
  const StandingGuess* guess = FindUp(guesses, kY);
  ASSERT_NE(guess, nullptr);
  std::vector<double> feet = guess->feet;
  std::sort(feet.begin(), feet.end());
  // Each of the levels -0.4 and 0.3, less a top of 0.5 and of 0.8; to a part of a slab.
  const std::vector<double> expected = {-1.2, -0.9, -0.5, -0.2};
  ASSERT_EQ(feet.size(), expected.size());
  for (std::size_t k = 0; k < feet.size(); ++k) EXPECT_NEAR(feet[k], expected[k], 0.02);
}

TEST(GuessWithoutFloor, WhereNothingFacesUpAnyHeightMayBeTheFoot) {
  std::vector<OrientedPoint> points = {{{0, -1, 2}, kX, 0.1}, {{0, 0.5, 2}, kX, 0.1}};
  const std::vector<StandingGuess> guesses = Guess(points, {}, {Plane(kX, -1), Plane(kZ, -2)});
  const StandingGuess* guess = FindUp(guesses, kY);
  ASSERT_NE(guess, nullptr);
  const double slab = MakeStackOutline(Stack()).slab;
  // From where its top would be at the lowest point up to where its foot would be at the highest.
  EXPECT_NEAR(guess->feet.front(), -1 - 0.8, 1e-9);
  EXPECT_GT(guess->feet.back(), 0.5 - slab - 1e-9);
  for (std::size_t k = 1; k < guess->feet.size(); ++k)
    EXPECT_NEAR(guess->feet[k] - guess->feet[k - 1], slab, 1e-9);
}

TEST(GuessWithoutFloor, NeedsAPlaneThatMayBeASide) {
  EXPECT_TRUE(Guess({}, {Plane(kX, -1), Plane(kY, -1)}, {}).empty());
  EXPECT_TRUE(Guess({}, {}, {}, {kY}).empty());
}

}  // namespace
}  // namespace volalign::standing_guesses_test
