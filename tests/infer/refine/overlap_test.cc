#include "infer/refine/overlap.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

#include "tests/infer/refine/points_and_evidence.h"

namespace volalign::refine_internal {
namespace {

/// A wall at z = 2 m (plus `farther`) as a sensor at (x, 0, 0) sees it: a grid of 2 cm, 1 m wide
/// and 20 cm high, straight ahead of it.
SensorPoints Wall(double farther) {
  std::vector<CloudPoint> cloud;
  for (int i = -25; i < 25; ++i) {
    for (int j = -5; j < 5; ++j)
      cloud.push_back({{0.02 * i, 0.02 * j, 2 + farther}, {0, 0, -1}, BlockUse::kFit});
  }
  return SensorPoints({}, {}, cloud);
}

SensorState At(double x) {
  Pose pose = Pose::Identity();
  pose.translation().x() = x;
  return {pose, 0, 0};
}

std::vector<int> All(const SensorPoints& points) {
  std::vector<int> all(points.cloud().size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

TEST(FindMatches, AreTheNearestPointsThatFaceTheSameWay) {
  const SensorPoints a = Wall(0.01), b = Wall(0);
  const std::vector<int> all = All(a);
  const OverlapView view_a{&a, &all, At(0)}, view_b{&b, &all, At(0.5)};
  const std::vector<Match> matches = FindMatches(view_a, view_b, 0.015, 0.9);
  ASSERT_EQ(matches.size(), a.cloud().size() / 2) << "b is half a metre further";
  for (const Match& match : matches) {
    // In front of the plane is positive; a sees it 1 cm too far.
    EXPECT_NEAR(match.residual, -0.01, 1e-12);
    const Eigen::Vector3d gap =
        view_a.Cloud(match.from).p - Eigen::Vector3d(0.5, 0, 0) - view_b.Cloud(match.to).p;
    EXPECT_LT(gap.head<2>().norm(), 1e-9);
  }
  EXPECT_TRUE(FindMatches(view_a, view_b, 0.009, 0.9).empty()) << "the gate";
  // What is known of a's depth is taken out.
  OverlapView corrected = view_a;
  corrected.state.offset = -0.01;
  for (const Match& match : FindMatches(corrected, view_b, 0.015, 0.9))
    EXPECT_NEAR(match.residual, 0, 1e-12);
  // A wall's back is another surface.
  std::vector<CloudPoint> turned = b.cloud();
  for (CloudPoint& point : turned) point.normal = -point.normal;
  const SensorPoints back({}, {}, turned);
  EXPECT_TRUE(FindMatches(view_a, {&back, &all, At(0.5)}, 0.015, 0.9).empty());
}

TEST(FindPairs, CountWhatBothSee) {
  const SensorPoints a = Wall(0.01), b = Wall(0);
  const std::vector<int> all = All(a);
  const std::vector<OverlapView> views = {
      {&a, &all, At(0)}, {&b, &all, At(0.5)}, {&b, &all, At(0.9)}};
  const std::vector<Pair> pairs = FindPairs(views, 0.015, 0.9, 0.3);
  ASSERT_EQ(pairs.size(), 2u) << "0 and 2 share a tenth";
  EXPECT_EQ(pairs[0].a, 0);
  EXPECT_EQ(pairs[0].b, 1);
  EXPECT_NEAR(pairs[0].overlap, 0.5, 0.01);
  EXPECT_NEAR(pairs[0].rms, 0.01, 1e-9);
  EXPECT_EQ(pairs[1].a, 1);
  EXPECT_EQ(pairs[1].b, 2);
  EXPECT_NEAR(pairs[1].overlap, 0.6, 0.01);
  EXPECT_NEAR(pairs[1].rms, 0, 1e-9);
  EXPECT_EQ(FindPairs(views, 0.015, 0.9, 0.05).size(), 3u);
}

TEST(FindPairs, OfNeighboursOnARing) {
  const testing_infer::Rig rig = testing_infer::RingOfEight();
  const std::vector<SensorPoints> points = testing_infer::PointsOf(rig);
  std::vector<std::vector<int>> chosen;
  std::vector<OverlapView> views;
  for (std::size_t i = 0; i < 2; ++i)
    chosen.push_back(
        ChooseOverlapPoints(rig.structure, points[i], *rig.frames[i].ground_truth, 700));
  for (std::size_t i = 0; i < 2; ++i)
    views.push_back({&points[i], &chosen[i], {*rig.frames[i].ground_truth, 0, 0}});
  const std::vector<Pair> pairs = FindPairs(views, 0.02, 0.94, 0.05);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_GT(pairs[0].overlap, 0.3);
  EXPECT_LT(pairs[0].rms, 1e-3);
}

TEST(ChooseOverlapPoints, TakesMostFromAroundTheStructure) {
  const Structure structure = testing_infer::PaperStructure();
  std::vector<CloudPoint> cloud;
  cloud.reserve(1000);
  for (int i = 0; i < 1000; ++i)
    cloud.push_back({{i % 2 ? 0.0 : 3.0, 0, 1e-4 * i}, {0, 0, -1}, BlockUse::kFit});
  const SensorPoints points({}, {}, cloud);
  const std::vector<int> chosen = ChooseOverlapPoints(structure, points, Pose::Identity(), 100);
  ASSERT_EQ(chosen.size(), 100u);
  int near = 0;
  for (const int i : chosen) near += i % 2;
  EXPECT_EQ(near, 70);
  EXPECT_TRUE(ChooseOverlapPoints(structure, points, Pose::Identity(), 0).empty());
  // Where few are near, the rest comes from farther away.
  cloud.resize(20);
  while (cloud.size() < 500) cloud.push_back({{3, 0, 0}, {0, 0, -1}, BlockUse::kFit});
  const SensorPoints mostly_far({}, {}, cloud);
  EXPECT_EQ(ChooseOverlapPoints(structure, mostly_far, Pose::Identity(), 100).size(), 100u);
}

}  // namespace
}  // namespace volalign::refine_internal
