#include "infer/initial/stack_votes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <vector>

#include "core/base/random.h"
#include "infer/initial/stack_search.h"

namespace volalign::stack_votes_test {
namespace {

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

/// The weight of each cell, by (dx, dz).
std::map<std::pair<int, int>, double> Cells(const std::vector<Vote>& votes) {
  std::map<std::pair<int, int>, double> cells;
  for (const Vote& vote : votes) cells[{vote.dx, vote.dz}] += vote.weight;
  return cells;
}

TEST(Votes, SpreadsAPieceOverTheFourCellsRoundIt) {
  const StackOutline outline = Outline();
  Votes votes(outline);
  votes.Make({{0.225, -0.16, 1, 0, StackPiece::kTop, 0.8}}, 0);
  const auto cells = Cells(votes.Of(1, kUp));
  ASSERT_EQ(cells.size(), 4u);
  EXPECT_NEAR(cells.at({2, -2}), 0.8 * 0.75 * 0.6, 1e-6);
  EXPECT_NEAR(cells.at({3, -2}), 0.8 * 0.25 * 0.6, 1e-6);
  EXPECT_NEAR(cells.at({2, -1}), 0.8 * 0.75 * 0.4, 1e-6);
  EXPECT_NEAR(cells.at({3, -1}), 0.8 * 0.25 * 0.4, 1e-6);
  for (const int way : {0, 3, 7, kInside}) EXPECT_TRUE(votes.Of(1, way).empty()) << way;
  EXPECT_TRUE(votes.Of(0, kUp).empty());
  EXPECT_TRUE(votes.Of(2, kUp).empty());
}

TEST(Votes, ForgetsTheTurnBefore) {
  const StackOutline outline = Outline();
  Votes votes(outline);
  votes.Make({{0.2, 0, 0, 0, StackPiece::kTop, 1}}, 0);
  votes.Make({{-0.3, 0, 0, 0, StackPiece::kTop, 1}}, 0);
  const auto cells = Cells(votes.Of(0, kUp));
  ASSERT_EQ(cells.count({-3, 0}), 1u);
  EXPECT_NEAR(cells.at({-3, 0}), 1, 1e-5);
  EXPECT_EQ(cells.count({2, 0}), 0u);
}

TEST(Votes, NoCellCountsMoreThanOneOrLessThanTheInside) {
  const StackOutline outline = Outline();
  Votes votes(outline);
  const StackPiece top{0, 0, 0, 0, StackPiece::kTop, 1};
  const StackPiece inside{0, 0, 0, 0, StackPiece::kInside, kInsideVote};
  votes.Make({top, top, inside, inside}, 0);
  EXPECT_EQ(Cells(votes.Of(0, kUp)).at({0, 0}), 1);
  EXPECT_EQ(Cells(votes.Of(0, kInside)).at({0, 0}), kInsideVote);
}

// A turn by `yaw` about +y takes +x to (cos, 0, -sin): by Eigen's matrix.
TEST(Votes, TurnsPlaceAndHeading) {
  const StackOutline outline = Outline();
  RandomStream random(3, 0, "votes");
  for (int k = 0; k < 40; ++k) {
    const double yaw = random.Uniform(0, 2 * M_PI), heading = random.Uniform(-M_PI, M_PI);
    const double x = random.Uniform(-0.3, 0.3), z = random.Uniform(-0.3, 0.3);
    Votes votes(outline);
    votes.Make({{x, z, 0, heading, StackPiece::kSide, 1}}, yaw);
    const Eigen::AngleAxisd turn(yaw, Eigen::Vector3d::UnitY());
    const Eigen::Vector3d place = turn * Eigen::Vector3d(x, 0, z) / outline.cell;
    const Eigen::Vector3d normal = turn * Eigen::Vector3d(std::cos(heading), 0, std::sin(heading));
    // Its own sector, and the neighbour whose border is nearer.
    const double sector = std::fmod(Heading(normal) + 2 * M_PI, 2 * M_PI) / (M_PI / 4);
    const int own = static_cast<int>(sector) % 8;
    const int other = (own + (sector - std::floor(sector) > 0.5 ? 1 : 7)) % 8;
    for (int way = 0; way < 8; ++way) {
      const std::vector<Vote>& list = votes.Of(0, way);
      ASSERT_EQ(list.empty(), way != own && way != other) << "heading " << Heading(normal);
      double sum = 0, mean_x = 0, mean_z = 0;
      for (const Vote& vote : list) {
        sum += vote.weight;
        mean_x += vote.weight * vote.dx;
        mean_z += vote.weight * vote.dz;
      }
      if (list.empty()) continue;
      EXPECT_NEAR(sum, 1, 1e-5);
      EXPECT_NEAR(mean_x, place.x(), 1e-4);
      EXPECT_NEAR(mean_z, place.z(), 1e-4);
    }
  }
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

TEST(FindOccupied, SeesTheRoomsOwnHorizontal) {
  const Eigen::Vector3d up = Eigen::Vector3d(0.2, -0.9, -0.3).normalized();
  const Eigen::Matrix3d room = RoomFromSensor(up);
  const Eigen::Vector3d in_room(-0.7, -0.5, 0.4);
  const std::vector<OccupiedCell> cells =
      FindOccupied({PointAt(room.transpose() * in_room, up, 1)}, Outline(), -0.6, room);
  ASSERT_EQ(cells.size(), 1u);
  EXPECT_EQ(std::make_tuple(cells[0].x, cells[0].z, cells[0].slab, cells[0].way),
            std::make_tuple(-7, 4, 0, kUp));
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
      for (int k = 0; k < 4; ++k) {
        occupied.push_back({random.Below(9) - 12, random.Below(9) + 4, slab, way,
                            static_cast<float>(random.Uniform(0.2, 1))});
      }
    }
  }
  VoteMap map(occupied, outline);
  map.Count(occupied, votes);
  map.Count(occupied, votes);  // counts anew
  float most = 0;
  std::vector<Peak> peaks;
  map.AppendPeaks(3, 1, &most, &peaks);
  double highest = 0;
  std::map<std::pair<int, int>, double> all;
  for (int x = -30; x < 20; ++x) {
    for (int z = -15; z < 35; ++z) {
      all[{x, z}] = VotesAt(x, z, occupied, votes);
      highest = std::max(highest, all[{x, z}]);
    }
  }
  EXPECT_NEAR(most, highest, 1e-4);
  std::vector<std::pair<int, int>> expected;
  for (const auto& [place, sum] : all) {
    const int x = place.first, z = place.second;
    const auto beside = [&](int dx, int dz) {
      const auto found = all.find({x + dx, z + dz});
      return found != all.end() ? found->second : 0;
    };
    if (sum > kLeastVotes * highest && sum > beside(1, 0) && sum > beside(-1, 0) &&
        sum > beside(0, 1) && sum > beside(0, -1))
      expected.push_back(place);
  }
  std::vector<std::pair<int, int>> found;
  for (const Peak& peak : peaks) {
    EXPECT_NEAR(peak.votes, all.at({peak.x, peak.z}), 1e-4);
    EXPECT_EQ(peak.turn, 3);
    EXPECT_EQ(peak.foot, 1);
    found.emplace_back(peak.x, peak.z);
  }
  std::sort(found.begin(), found.end());
  EXPECT_EQ(found, expected);
  EXPECT_GE(expected.size(), 1u);
  // What an earlier turn has found twice as high leaves none of these.
  float higher = 3 * most;
  peaks.clear();
  map.AppendPeaks(4, 1, &higher, &peaks);
  EXPECT_TRUE(peaks.empty());
  EXPECT_EQ(higher, 3 * most);
}

}  // namespace
}  // namespace volalign::stack_votes_test
