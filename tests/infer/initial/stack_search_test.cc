#include "infer/initial/stack_search.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/visibility.h"
#include "infer/initial/stack_outline.h"
#include "infer/initial/stack_votes.h"
#include "infer/initial/standing_guesses.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::stack_search_test {
namespace {

using namespace testing_infer;

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

/// A sensor 2 m away, tilted and rolled.
Pose Somewhere(double phi_deg) { return RingPose(phi_deg, 2.1, 1.2, 35, {0.3, 0.3, 0}); }

class SearchStackTest : public testing::Test {
 protected:
  /// The way in which the stack stands at a pose.
  StandingGuess GuessOf(const Pose& truth) const {
    StandingGuess guess;
    guess.up = truth.linear().transpose() * Eigen::Vector3d::UnitY();
    // The foot as seen from the sensor: its own height less that of the structure's lowest point.
    guess.feet = {structure_.FloorHeight() - truth.translation().y()};
    return guess;
  }
  std::vector<std::vector<StackCandidate>> Search(const Pose& truth,
                                                  const std::vector<StandingGuess>& guesses,
                                                  int most) const {
    return SearchStack(SurfaceOf(structure_, truth), outline_, guesses, most);
  }

  const Structure structure_ = Stack();
  const StackOutline outline_ = MakeStackOutline(structure_);
};

TEST_F(SearchStackTest, FindsItWhereItStands) {
  for (const double phi : {10.0, 100.0, 195.0, 290.0}) {
    const Pose truth = Somewhere(phi);
    const StandingGuess guess = GuessOf(truth);
    const auto found = Search(truth, {guess}, 4);
    ASSERT_EQ(found.size(), 1u);
    ASSERT_GE(found[0].size(), 1u);
    const Pose& best = found[0][0].structure_from_sensor;
    EXPECT_TRUE((best.linear() * guess.up).isApprox(Eigen::Vector3d::UnitY(), 1e-9));
    // A turn on either side of the true one; a cell, where the stack's middle comes to lie.
    const PoseError error = ComparePoses(best, truth);
    EXPECT_LT(error.rotation_deg, outline_.yaw_step * 180 / M_PI) << phi;
    const Eigen::Vector3d off = best * (truth.inverse() * outline_.foot) - outline_.foot;
    EXPECT_LT(off.norm(), 1.5 * outline_.cell) << phi;
    EXPECT_NEAR(off.y(), 0, 1e-9) << phi;
    for (std::size_t k = 1; k < found[0].size(); ++k)
      EXPECT_LE(found[0][k].votes, found[0][k - 1].votes);
    EXPECT_LE(found[0].size(), 4u);
  }
}

/// The turn of the room frame from the structure's, rad.
double YawOf(const Pose& structure_from_sensor, const Eigen::Vector3d& up) {
  const Eigen::Matrix3d turn = RoomFromSensor(up) * structure_from_sensor.linear().transpose();
  return std::atan2(turn(0, 2), turn(0, 0));
}

// Also where it stands between the last turn and the first, which are neighbours.
TEST_F(SearchStackTest, NoTwoCandidatesAreOne) {
  const Eigen::Vector3d up = GuessOf(Somewhere(60)).up;
  const double yaw = YawOf(Somewhere(60), up);
  for (const double wanted : {-0.3 * outline_.yaw_step, 1.0}) {
    const Pose turn(Eigen::AngleAxisd(yaw - wanted, Eigen::Vector3d::UnitY()));
    const Pose truth = turn * Somewhere(60);
    ASSERT_NEAR(YawOf(truth, up), wanted, 1e-9);
    const auto found = Search(truth, {GuessOf(truth)}, 50);
    ASSERT_FALSE(found[0].empty());
    EXPECT_LT(ComparePoses(found[0][0].structure_from_sensor, truth).rotation_deg, 4);
    for (std::size_t k = 0; k < found[0].size(); ++k) {
      EXPECT_GE(found[0][k].votes, kLeastVotes * found[0][0].votes);
      for (std::size_t j = 0; j < k; ++j) {
        const Pose& a = found[0][j].structure_from_sensor;
        const Pose& b = found[0][k].structure_from_sensor;
        const double apart = (a.inverse() * outline_.foot - b.inverse() * outline_.foot).norm();
        const double turned = ComparePoses(a, b).rotation_deg * M_PI / 180;
        EXPECT_TRUE(apart > 2 * outline_.cell || turned > 2 * outline_.yaw_step)
            << wanted << ": " << j << " and " << k;
      }
    }
  }
}

// Which of two heights is the floor's is not for the votes to say.
TEST_F(SearchStackTest, FindsItOnEveryFoot) {
  const Pose truth = Somewhere(60);
  StandingGuess guess = GuessOf(truth);
  const double foot = guess.feet[0];
  guess.feet = {foot - 0.03, foot};
  const auto found = Search(truth, {guess}, 20);
  for (const double high : guess.feet) {
    const bool is_found =
        std::any_of(found[0].begin(), found[0].end(), [&](const StackCandidate& candidate) {
          const Pose& pose = candidate.structure_from_sensor;
          const Eigen::Vector3d at = RoomFromSensor(guess.up) * (pose.inverse() * outline_.foot);
          return std::abs(at.y() - high) < 1e-9 && ComparePoses(pose, truth).rotation_deg < 4;
        });
    EXPECT_TRUE(is_found) << high;
  }
}

// Only the turns that are asked for are tried, each on its own.
TEST_F(SearchStackTest, KeepsToTheTurnsOfTheGuess) {
  const Pose truth = Somewhere(200);
  StandingGuess guess = GuessOf(truth);
  const double yaw = YawOf(truth, guess.up);
  guess.yaws = {yaw + 1.0, yaw, yaw + 0.05};
  const auto found = Search(truth, {guess}, 10);
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

// Ways: sectors of 45 deg from the heading 0 on, then up, then inside.
constexpr int kUp = 8, kInside = 9;

/// Cells of 10 cm, three slabs of 20 cm.
StackOutline Outline() {
  StackOutline outline;
  outline.cell = 0.1;
  outline.slab = 0.2;
  outline.slabs = 3;
  outline.radius = 0.5;
  return outline;
}

/// The weight of the cell in the middle.
double Middle(const std::vector<Vote>& votes) {
  double sum = 0;
  for (const Vote& vote : votes) sum += vote.dx == 0 && vote.dz == 0 ? vote.weight : 0;
  return sum;
}

TEST(Votes, NoCellCountsMoreThanOneOrLessThanTheInside) {
  const StackOutline outline = Outline();
  Votes votes(outline);
  const StackPiece top{0, 0, 0, 0, StackPiece::kTop, 1};
  const StackPiece inside{0, 0, 0, 0, StackPiece::kInside, kInsideVote};
  votes.Make({top, top, inside, inside}, 0);
  EXPECT_EQ(Middle(votes.Of(0, kUp)), 1);
  EXPECT_EQ(Middle(votes.Of(0, kInside)), kInsideVote);
}

OrientedPoint PointAt(const Eigen::Vector3d& p, const Eigen::Vector3d& normal, double area) {
  return {p, normal.normalized(), area};
}

TEST(FindOccupied, SortsPointsIntoCells) {
  const Eigen::Vector3d up(0, 1, 0), aside(1, 0, 0.1), steep(1, 0.8, 0);
  // The foot is 1 m under the sensor. Half of a cell is 0.1 x 0.1 / 2 of a top, 0.1 x 0.2 / 2 of a
  // side.
  const std::vector<OrientedPoint> points = {
      PointAt({0.31, -0.85, 2.0}, up, 0.001),   PointAt({0.29, -0.82, 2.04}, up, 0.0015),
      PointAt({0.31, -0.75, 2.0}, aside, 0.02), PointAt({0.31, -0.75, 2.0}, steep, 1),
      PointAt({0.31, -0.98, 2.0}, up, 1),  // within 3 cm of the floor
      PointAt({0.31, -0.3, 2.0}, up, 1),   // above all slabs
      PointAt({0.31, -1.1, 2.0}, up, 1),   // below them
      PointAt({0.31, -0.85, 8.1}, up, 1),  // too far away
      PointAt({0.31, -0.85, 2.0}, -up, 1)};
  const std::vector<OccupiedCell> cells =
      FindOccupied(points, Outline(), -1, Eigen::Matrix3d::Identity());
  ASSERT_EQ(cells.size(), 2u);
  for (const OccupiedCell& cell : cells) {
    EXPECT_EQ(std::make_tuple(cell.x, cell.z), std::make_tuple(3, 20));
    EXPECT_EQ(cell.slab, cell.way == kUp ? 0 : 1);
    EXPECT_NEAR(cell.weight, cell.way == kUp ? 0.0025 / 0.005 : 1, 1e-6);
  }
  EXPECT_EQ(cells[0].way, kUp);
  EXPECT_EQ(cells[1].way, 0);
}

/// The votes of a place, summed up cell by cell.
double VotesAt(int x, int z, const std::vector<OccupiedCell>& occupied, const Votes& votes) {
  double sum = 0;
  for (const OccupiedCell& cell : occupied) {
    for (const int way : {cell.way, kInside}) {
      for (const Vote& vote : votes.Of(cell.slab, way)) {
        if (cell.x - vote.dx == x && cell.z - vote.dz == z) sum += cell.weight * vote.weight;
      }
    }
  }
  return sum;
}

TEST(VoteMap, IsACorrelation) {
  const StackOutline outline = Outline();
  RandomStream random(5, 0, "vote map");
  std::vector<StackPiece> pieces;
  for (int k = 0; k < 60; ++k) {
    const auto kind = static_cast<StackPiece::Kind>(k % 3);
    pieces.push_back({random.Uniform(-0.3, 0.3), random.Uniform(-0.3, 0.3), k % 2,
                      random.Uniform(-3, 3), kind, kind == StackPiece::kInside ? kInsideVote : 1});
  }
  Votes votes(outline);
  votes.Make(pieces, 0.7);
  std::vector<OccupiedCell> occupied;
  for (int slab = 0; slab < 3; ++slab) {
    for (int way = 0; way <= kUp; ++way) {
      for (int k = 0; k < 4; ++k)
        occupied.push_back({random.Below(9) - 12, random.Below(9) + 4, slab, way,
                            static_cast<float>(random.Uniform(0.2, 1))});
    }
  }
  VoteMap map(occupied, outline);
  map.Count(occupied, votes);
  map.Count(occupied, votes);  // counts anew
  float most = 0;
  std::vector<Peak> peaks;
  map.AppendPeaks(3, 1, &most, &peaks);
  const auto at = [&](int x, int z) { return VotesAt(x, z, occupied, votes); };
  const auto is_peak = [&](int x, int z) {
    return at(x, z) > std::max({kLeastVotes * double{most}, at(x + 1, z), at(x - 1, z),
                                at(x, z + 1), at(x, z - 1)});
  };
  double highest = 0;
  std::size_t expected = 0;
  for (const auto [u, v] : Pixels({-30, -15}, {20, 35})) {
    highest = std::max(highest, at(u, v));
    expected += is_peak(u, v);
  }
  EXPECT_NEAR(most, highest, 1e-4);
  EXPECT_EQ(peaks.size(), expected);
  EXPECT_GE(expected, 1u);
  for (const Peak& peak : peaks) {
    EXPECT_TRUE(is_peak(peak.x, peak.z));
    EXPECT_NEAR(peak.votes, at(peak.x, peak.z), 1e-4);
    EXPECT_EQ(peak.turn, 3);
    EXPECT_EQ(peak.foot, 1);
  }
  // What an earlier turn has found twice as high leaves none of these.
  float higher = 3 * most;
  peaks.clear();
  map.AppendPeaks(4, 1, &higher, &peaks);
  EXPECT_TRUE(peaks.empty());
  EXPECT_EQ(higher, 3 * most);
}

TEST(MakeStackOutline, HasLimits) {
  const auto outline = [](const Eigen::Vector3d& size) {
    return MakeStackOutline(Structure::FromBoxes("box", {Standing("b", size, {0, 0, 0})}));
  };
  EXPECT_NEAR(outline({0.9, 2.5, 0.9}).cell, 0.06, 1e-12);
  EXPECT_NEAR(outline({0.9, 2.5, 0.9}).slab, 0.2, 1e-12);
  // 5 m high in 16 slabs; a radius of 2 m in 16 cells.
  EXPECT_NEAR(outline({0.3, 5, 0.3}).slab, 5.0 / 16, 1e-12);
  EXPECT_NEAR(outline({4, 0.5, 0.3}).cell, std::hypot(4, 0.3) / 2 / 16, 1e-12);
}

const Eigen::Vector3d kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);

/// Of 1 m^2.
RoomPlane Plane(const Eigen::Vector3d& normal, double offset) { return {normal, offset, 1}; }

/// 0.5 m and 0.8 m high tops.
Structure TwoLevels() {
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
  const Structure structure = TwoLevels();
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
  const Structure stack = TwoLevels();
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
  const double slab = MakeStackOutline(TwoLevels()).slab;
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
}  // namespace volalign::stack_search_test
