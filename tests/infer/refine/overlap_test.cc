#include "infer/refine/overlap.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <numeric>
#include <vector>

#include "core/geometry/sensor_kind.h"
#include "core/geometry/visibility.h"
#include "infer/refine/association.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/problem.h"
#include "infer/refine/solution.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/refine/two_sensors.h"

namespace volalign::refine_internal::overlap_test {
namespace {

/// A wall at z = 2 m (plus `farther`) as a sensor at (x, 0, 0) sees it: a grid of 2 cm, 1 m wide
/// and 20 cm high, straight ahead of it.
SensorPoints Wall(double farther) {
  std::vector<CloudPoint> cloud;
  for (int i = -25; i < 25; ++i) {
    for (int j = -5; j < 5; ++j) cloud.push_back({{0.02 * i, 0.02 * j, 2 + farther}, {0, 0, -1}});
  }
  return SensorPoints{{}, {}, SampledCloud(cloud)};
}

FrameState At(double x) { return {Pose(Eigen::Translation3d(x, 0, 0)), 0, 0}; }

std::vector<int> All(const SensorPoints& points) {
  std::vector<int> all(points.cloud.points().size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

TEST(FindMatches, AreTheNearestPointsThatFaceTheSameWay) {
  const SensorPoints a = Wall(0.01), b = Wall(0);
  const std::vector<int> all = All(a);
  const OverlapEnd view_a{&a, &all, At(0)}, view_b{&b, &all, At(0.5)};
  const std::vector<Match> matches = FindMatches(view_a, view_b, 0.015, 0.9);
  ASSERT_EQ(matches.size(), a.cloud.points().size() / 2) << "b is half a metre further";
  for (const Match& match : matches) {
    // In front of the plane is positive; a sees it 1 cm too far.
    EXPECT_NEAR(match.residual, -0.01, 1e-12);
    const Eigen::Vector3d gap =
        view_a.Cloud(match.from).p - Eigen::Vector3d(0.5, 0, 0) - view_b.Cloud(match.to).p;
    EXPECT_LT(gap.head<2>().norm(), 1e-9);
  }
  EXPECT_TRUE(FindMatches(view_a, view_b, 0.009, 0.9).empty()) << "the gate";
  // What is known of a's depth is taken out.
  OverlapEnd corrected = view_a;
  corrected.state.offset = -0.01;
  for (const Match& match : FindMatches(corrected, view_b, 0.015, 0.9))
    EXPECT_NEAR(match.residual, 0, 1e-12);
  // So is what is known of b's, by which its points are sought where b has measured them: 20 cm
  // off, along their rays.
  const SensorPoints scaled = Wall(0.2);
  OverlapEnd near_view{&scaled, &all, At(0)};
  near_view.state.gain_error = 2 / 2.2 - 1;
  const std::vector<Match> scaled_back = FindMatches({&b, &all, At(0)}, near_view, 0.015, 0.9);
  EXPECT_GT(scaled_back.size(), 400u);
  for (const Match& match : scaled_back) EXPECT_NEAR(match.residual, 0, 1e-12);
  // A wall's back is another surface.
  std::vector<CloudPoint> turned = b.cloud.points();
  for (CloudPoint& point : turned) point.normal = -point.normal;
  const SensorPoints back{{}, {}, SampledCloud(turned)};
  EXPECT_TRUE(FindMatches(view_a, {&back, &all, At(0.5)}, 0.015, 0.9).empty());
}

TEST(FindShared, CountsWhatBothSee) {
  const SensorPoints a = Wall(0.01), b = Wall(0);
  const std::vector<int> all = All(a);
  const OverlapEnd first{&a, &all, At(0)}, second{&b, &all, At(0.5)}, third{&b, &all, At(0.9)};
  const SharedPoints near = FindShared(first, second, 0.015, 0.9);
  EXPECT_TRUE(near.IsPair(0.3));
  EXPECT_NEAR(near.overlap, 0.5, 0.01);
  EXPECT_NEAR(near.rms(), 0.01, 1e-9);
  const SharedPoints exact = FindShared(second, third, 0.015, 0.9);
  EXPECT_TRUE(exact.IsPair(0.3));
  EXPECT_NEAR(exact.overlap, 0.6, 0.01);
  EXPECT_NEAR(exact.rms(), 0, 1e-9);
  const SharedPoints far = FindShared(first, third, 0.015, 0.9);
  EXPECT_FALSE(far.IsPair(0.3)) << "they share a tenth";
  EXPECT_TRUE(far.IsPair(0.05));
}

TEST(ChooseOverlapPoints, TakesHalfFromAroundTheStructure) {
  const Structure structure = testing_infer::PaperStructure();
  std::vector<CloudPoint> cloud;
  cloud.reserve(1000);
  for (int i = 0; i < 1000; ++i) cloud.push_back({{i % 2 ? 0.0 : 3.0, 0, 1e-4 * i}, {0, 0, -1}});
  const SensorPoints points{{}, {}, SampledCloud(cloud)};
  const std::vector<int> chosen =
      ChooseOverlapPoints(structure, points, Pose::Identity(), 100, true);
  ASSERT_EQ(chosen.size(), 100u);
  int near = 0;
  for (const int i : chosen) near += i % 2;
  EXPECT_EQ(near, 50);
  EXPECT_TRUE(ChooseOverlapPoints(structure, points, Pose::Identity(), 0, true).empty());
  // Where few are near, the rest comes from farther away.
  cloud.resize(20);
  while (cloud.size() < 500) cloud.push_back({{3, 0, 0}, {0, 0, -1}});
  const SensorPoints mostly_far{{}, {}, SampledCloud(cloud)};
  EXPECT_EQ(ChooseOverlapPoints(structure, mostly_far, Pose::Identity(), 100, true).size(), 100u);
}

// What the structure's own terms say already is not for the fit.
TEST(ChooseOverlapPoints, OnlyThoseBesideTheStructure) {
  const testing_infer::Rig rig = testing_infer::RingOfEight();
  const std::vector<SensorPoints> points = testing_infer::PointsOf(rig);
  const Pose& pose = *rig.frames[0].ground_truth;
  const auto on_structure = [&](bool all) {
    int count = 0;
    for (const int i : ChooseOverlapPoints(rig.structure, points[0], pose, 500, all)) {
      const CloudPoint& point = points[0].cloud.points()[static_cast<std::size_t>(i)];
      count += DistanceToSurface(rig.structure, pose * point.p).distance < 0.06 ? 1 : 0;
    }
    return count;
  };
  EXPECT_EQ(on_structure(false), 0);
  EXPECT_GT(on_structure(true), 50);
}

// Of a sensor as many are matched with all others together, however many these are.
TEST(JointProblem, SharesAFramesPointsBetweenTheOthers) {
  const testing_infer::Rig rig = testing_infer::RingOfEight();
  const std::vector<SensorPoints> points = testing_infer::PointsOf(rig);
  for (const std::size_t size : {std::size_t{1}, std::size_t{3}, std::size_t{8}}) {
    std::vector<FrameInput> frames;
    for (std::size_t i = 0; i < size; ++i) {
      const Pose& pose = *rig.frames[i].ground_truth;
      frames.push_back({testing_infer::Borrowed(points[i]), pose});
    }
    RefineOptions options;
    options.max_overlap_points = 1400;
    const JointProblem problem(rig.structure, frames, options);
    for (std::size_t i = 0; i < size; ++i) {
      const int most = size == 1 ? 0 : 1400 / (static_cast<int>(size) - 1);
      EXPECT_EQ(problem.overlap_points[i],
                ChooseOverlapPoints(rig.structure, points[i], frames[i].start, most, false))
          << size;
    }
  }
}

// Rounds of the refinement begin at poses that differ by millimetres; with other points in each,
// they would not settle.
TEST(ChooseOverlapPoints, ChangesLittleWithThePose) {
  const testing_infer::Rig rig = testing_infer::RingOfEight();
  const std::vector<SensorPoints> points = testing_infer::PointsOf(rig);
  Pose pose = *rig.frames[0].ground_truth;
  std::vector<int> before = ChooseOverlapPoints(rig.structure, points[0], pose, 700, true);
  pose.translation() += Eigen::Vector3d(0.004, -0.003, 0.005);
  std::vector<int> after = ChooseOverlapPoints(rig.structure, points[0], pose, 700, true), both;
  std::sort(before.begin(), before.end());
  std::sort(after.begin(), after.end());
  std::set_intersection(before.begin(), before.end(), after.begin(), after.end(),
                        std::back_inserter(both));
  EXPECT_GT(both.size(), 680u);
}

TEST(FindOverlaps, TrustsTheKindWhereNothingIsMeasured) {
  testing_infer::TwoSensors two(testing_infer::Strip(true, 2), testing_infer::Strip(true, 2));
  SensorLens lens;
  for (FrameInput& frame : two.frames) frame.lens = 0;
  for (const char* kind : {"realsense_d415", "kinect_v1", "azure_kinect"}) {
    lens.sensor = kind;
    const JointProblem problem(two.structure, two.frames, two.options, {lens});
    const FreeSet free = AskedFor({}, problem.priors, 2);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, GatherObservations(problem, two.state, free, {}), {0, 0}, two.state);
    ASSERT_EQ(overlaps.size(), 1u);
    const PairMatch& match = overlaps[0].of_a.at(0);
    const double expected = testing_infer::SigmaOfPair(match.point->p, ErrorsOf("").smooth_m);
    EXPECT_NEAR(match.sigma, expected, 0.02 * expected) << kind;
  }
}

TEST(FindOverlaps, SaysHowManyMeasurementsTheMatchesAreAndHowFarTheySpread) {
  // 60 matches in four cells of the errors, all of them 20 mm off.
  constexpr double kApart = 0.02;  // m
  const testing_infer::TwoSensors two(testing_infer::Strip(true, 2),
                                      testing_infer::Strip(true, 2 + kApart));
  const std::vector<PairOverlap> overlaps =
      FindOverlaps(two.Problem(), testing_infer::TwoFrames(), {0, 0}, two.state);
  ASSERT_EQ(overlaps.size(), 1u);
  EXPECT_EQ(overlaps[0].of_a.size(), 30u);
  EXPECT_EQ(overlaps[0].of_b.size(), 30u);
  EXPECT_NEAR(overlaps[0].cells, 4, 0.1);
  for (const PairMatch& match : overlaps[0].of_a) EXPECT_NEAR(match.residual, kApart, 1e-9);
  // The median of the sizes is that of a point halfway along.
  const double median = kApart / testing_infer::SigmaOfPair({0.6, 0.06, 2});
  EXPECT_NEAR(overlaps[0].excess, 1.4826 * median, 0.1 * median);
}

TEST(FindOverlaps, CountsWhatManyFramesSeeOnce) {
  const testing_infer::TwoSensors two(testing_infer::Strip(true, 2), testing_infer::Strip(true, 2));
  for (const std::size_t n : {2, 3, 5}) {
    const std::vector<FrameInput> frames(n, two.frames[0]);
    const JointProblem problem(two.structure, frames, two.options);
    const State state = NominalState(two.structure, std::vector<Pose>(n, two.pose));
    const std::vector<FrameObservations> observed(n, testing_infer::TwoFrames()[0]);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, observed, std::vector<char>(n, 0), state);
    ASSERT_EQ(overlaps.size(), n * (n - 1) / 2);
    for (const PairOverlap& pair : overlaps)
      EXPECT_NEAR(pair.cells, 4 * 2.0 / static_cast<double>(n), 0.1);
  }
}

TEST(FindOverlaps, LeavesOutAHeldFrame) {
  testing_infer::Neighbours made;
  const RefineOptions options;
  const auto pairs = [&](const std::vector<char>& fixed) {
    const JointProblem problem(made.rig.structure, made.frames, options);
    const State state = NominalState(made.rig.structure, made.poses);
    return FindOverlaps(problem, std::vector<FrameObservations>(2), fixed, state).size();
  };
  EXPECT_EQ(pairs({0, 0}), 1u);
  EXPECT_EQ(pairs({1, 0}), 0u);
}

/// 20 x 10 cm about the origin, facing up.
Side Table() {
  Side side;
  side.centre.setZero();
  side.axis_u = Eigen::Vector3d::UnitZ();
  side.axis_v = Eigen::Vector3d::UnitX();
  side.normal = Eigen::Vector3d::UnitY();
  side.half_u = 0.1;
  side.half_v = 0.05;
  return side;
}

TEST(NearestEdge, IsTheOneThatTheSilhouetteFaces) {
  // In a corner, 1 cm from the edge +v and 2 cm from +u: the direction decides.
  const Eigen::Vector3d p(0.06, 0, 0.12);
  const Side table = Table();
  const auto beyond = [&](int edge) {
    const Border border = table.BorderAt(edge);
    return border.outward.dot(p - table.centre) - border.extent;
  };
  ASSERT_EQ(NearestEdge(table, p, Eigen::Vector3d::UnitX(), 0.05), 2);
  EXPECT_NEAR(beyond(2), 0.01, 1e-12);
  ASSERT_EQ(NearestEdge(table, p, Eigen::Vector3d::UnitZ(), 0.05), 0);
  EXPECT_NEAR(beyond(0), 0.02, 1e-12);
  // In between, the nearer one.
  EXPECT_EQ(NearestEdge(table, p, Eigen::Vector3d(1, 0, 1).normalized(), 0.05), 2);
  EXPECT_EQ(NearestEdge(table, p, Eigen::Vector3d::UnitX(), 0.009), -1) << "the gate";
  EXPECT_EQ(NearestEdge(table, p, Eigen::Vector3d::UnitY(), 0.05), -1) << "no edge";
}

TEST(LiesOnItsSide, AsksForDistanceAndDirection) {
  const Structure structure = testing_infer::PaperStructure();
  const int label = testing_infer::LabelOf(structure, "top/front");
  const Side& side = structure.SideOfLabel(label);
  const FrameState sensor{testing_infer::RingPose(0), 0, 0};
  const Pose sensor_from_structure = sensor.structure_from_sensor.inverse();
  SidePoint point;
  point.label = label;
  point.p = sensor_from_structure * (side.centre + 0.03 * side.normal);
  point.normal.setZero();
  EXPECT_TRUE(LiesOnItsSide(structure, sensor, point, 0.04));
  EXPECT_FALSE(LiesOnItsSide(structure, sensor, point, 0.02));
  point.normal = sensor_from_structure.linear() * side.normal;
  EXPECT_TRUE(LiesOnItsSide(structure, sensor, point, 0.04));
  point.normal = sensor_from_structure.linear() * side.axis_u;
  EXPECT_FALSE(LiesOnItsSide(structure, sensor, point, 0.04)) << "a label that leaks round an edge";
  // A depth error that the sensor is known to have counts for nothing.
  point.normal.setZero();
  const double shift =
      0.03 / side.normal.dot(sensor.structure_from_sensor.linear() * point.p) * point.p.z();
  EXPECT_TRUE(LiesOnItsSide(structure, {sensor.structure_from_sensor, 0, -shift}, point, 0.001));
}

}  // namespace
}  // namespace volalign::refine_internal::overlap_test
