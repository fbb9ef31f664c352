#include "infer/refine/observations.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>
#include <vector>

#include "core/geometry/sensor_kind.h"
#include "core/geometry/visibility.h"
#include "infer/refine/association.h"
#include "infer/refine/box_edges.h"
#include "infer/refine/overlap.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/problem.h"
#include "infer/refine/sensor_points.h"
#include "infer/refine/silhouettes.h"
#include "infer/refine/solution.h"
#include "infer/view/alike.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/refine/two_sensors.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::refine_internal::observations_test {
namespace {

using namespace testing_infer;

/// Points of one image block on the top box's front, seen head on from 1.5 m: `off` in front of it.
struct Block {
  Structure structure = PaperStructure();
  int label = LabelOf(structure, "top/front");
  Pose pose = Pose::Identity();
  SensorPoints points;

  Block() {
    const Side& side = structure.SideOfLabel(label);
    pose.linear().col(2) = -side.normal;
    pose.linear().col(1) = side.axis_u;
    pose.linear().col(0) = pose.linear().col(1).cross(pose.linear().col(2));
    pose.translation() = side.centre + 1.5 * side.normal;
  }
  void Add(double x, double off, int block) {
    SidePoint point;
    point.p = {x, 0, 1.5 - off};
    point.normal = -Eigen::Vector3d::UnitZ();
    point.label = label;
    point.block = block;
    points.side_points.push_back(point);
  }
  FrameObservations Gather() const {
    FrameObservations observed;
    GatherObservations(structure, NominalState(structure, {pose}), 0, points, &observed);
    return observed;
  }
};

TEST(GatherObservations, TakesTheMeanOfABlockWithoutWhatLiesApart) {
  Block block;
  for (int i = 0; i < 4; ++i) block.Add(0.002 * i, i % 2 ? 0.001 : -0.001, 7);
  block.Add(0.05, 0.05, 7);  // of the same block, but 5 cm in front of the others
  block.Add(0.05, 0.07, 7);  // beyond the gate
  block.Add(0, 0, 8);        // too few of a block
  block.Add(0.001, 0, 8);
  const FrameObservations observed = block.Gather();
  ASSERT_EQ(observed.faces.size(), 1u);
  const FaceObservation& face = observed.faces[0];
  EXPECT_EQ(face.label, block.label);
  EXPECT_TRUE(face.p.isApprox(Eigen::Vector3d(0.003, 0, 1.5), 1e-9)) << face.p.transpose();
  // About the upper median of -1, -1, 1, 1 and 50 mm, which is 1 mm: squares 4 + 4 mm^2, of four
  // points that are worth two.
  EXPECT_NEAR(face.variance, 2 * 8e-6 / 16, 1e-12);
  const Side& side = block.structure.SideOfLabel(block.label);
  EXPECT_EQ(face.bulge, side.BulgeAt(block.pose * face.p));
  SensorErrorVector by_errors = SensorErrorVector::Zero();  // no multipath: nothing rises in front
  by_errors.head<kFrameErrors>() =
      FrameErrorsAt(observed.noise.depth, face.p, block.pose.linear().transpose() * side.normal);
  by_errors[kGain] = 1.5;
  by_errors[kDiffuseMultipath] =
      DiffuseMultipathShare(block.structure, side, block.pose * face.p, block.pose.translation(),
                            observed.noise.depth.bounce_reach_m);
  EXPECT_TRUE(face.by_errors.isApprox(by_errors, 1e-9)) << face.by_errors.transpose();
}

TEST(GatherObservations, WhatMayBeMeasuredAsideIsLeftOutWhereTheOthersAreEnough) {
  Block block;
  for (int i = 0; i < 8; ++i) block.Add(0.002 * i, 0, 7);
  for (std::size_t i = 3; i < 8; ++i) block.points.side_points[i].lateral_sigma_rad = 0.003;
  const FrameObservations enough = block.Gather();
  ASSERT_EQ(enough.faces.size(), 1u);
  EXPECT_EQ(enough.faces[0].lateral_sigma_rad, 0);
  EXPECT_NEAR(enough.faces[0].p.x(), 0.002, 1e-9);
  block.points.side_points[2].lateral_sigma_rad = 0.003;
  const FrameObservations all = block.Gather();
  ASSERT_EQ(all.faces.size(), 1u);
  EXPECT_NEAR(all.faces[0].lateral_sigma_rad, 0.003 * 6 / 8, 1e-9);
  EXPECT_NEAR(all.faces[0].p.x(), 0.007, 1e-9);
}

TEST(GatherObservations, APixelThatFramesDisagreeAboutSaysLess) {
  Block block;
  for (int i = 0; i < 4; ++i) block.Add(0.002 * i, i % 2 ? 0.001 : -0.001, 7);
  // One part in ten of the weight of the others, which it takes from the two in front.
  for (const int i : {1, 3}) block.points.side_points[static_cast<std::size_t>(i)].sigma = 0.003;
  const FrameObservations observed = block.Gather();
  ASSERT_EQ(observed.faces.size(), 1u);
  const FaceObservation& face = observed.faces[0];
  EXPECT_NEAR(face.p.z(), 1.5 + 0.001 * (2 - 0.2) / 2.2, 1e-9);
  // About the upper median, 1 mm: those behind it are 2 mm off.
  EXPECT_NEAR(face.variance, 2 * (2 * 4e-6) / (2.2 * 2.2), 1e-12);
}

TEST(WidenOutliers, CountsWhatExceedsTheLimitAndLeavesTheOthers) {
  // The limit is 3.5 mm where everything else agrees to less than a millimetre.
  constexpr std::size_t kOdd = 20;
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  const FrameObservations exact = Observe(structure, pose, 14);
  ASSERT_GT(exact.faces.size(), 60u);
  const auto widened = [&](double off, double offset_sigma = 0) {
    FrameObservations observed = exact;
    FaceObservation& odd = observed.faces[kOdd];
    odd.p += off * pose.linear().transpose() * structure.SideOfLabel(odd.label).normal;
    Priors priors;
    priors.offset = offset_sigma;
    WidenOutliers(model, ParameterPoint(model, pose).Parameters(), priors, &observed);
    for (std::size_t k = 0; k < exact.faces.size(); ++k) {
      if (k != kOdd) {
        EXPECT_EQ(observed.faces[k].variance, exact.faces[k].variance) << k;
      }
    }
    return odd.variance - exact.faces[kOdd].variance;
  };
  EXPECT_EQ(widened(0.0034), 0);
  EXPECT_NEAR(widened(0.005), 4 * (0.005 * 0.005 - 0.0035 * 0.0035), 6e-6);
  EXPECT_NEAR(widened(0.01), 4 * (0.01 * 0.01 - 0.0035 * 0.0035), 3e-5);
  // 5 cm, less the little that the fit follows: 4 (size^2 - limit^2).
  EXPECT_NEAR(std::sqrt(widened(0.05, 0.007) / 4), 0.05, 0.003);
}

/// Whether all pixels up to `reach` rows and columns away have the label.
bool IsOneSide(const LabelImage& labels, int u, int v, int reach) {
  bool same = true;
  for (const auto [x, y] : Pixels({u - reach, v - reach}, {u + reach + 1, v + reach + 1}))
    same = same && labels(x, y) == labels(u, v);
  return same;
}

/// Distance, m, of a silhouette from the nearest edge line of its side, positive outside of it.
double OutsideOfSide(const Structure& structure, const Pose& pose, const EdgePoint& edge) {
  const Side& side = structure.SideOfLabel(edge.label);
  const Eigen::Vector3d p = pose * edge.p - side.centre;
  const double du = std::abs(side.axis_u.dot(p)) - side.half_u;
  const double dv = std::abs(side.axis_v.dot(p)) - side.half_v;
  return std::abs(du) < std::abs(dv) ? du : dv;
}

TEST(PixelNormals, AreTheFacesOwn) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const auto rendered = Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  int tested = 0;
  for (int v = 4; v < view.height() - 4; v += 3) {
    for (int u = 4; u < view.width() - 4; u += 3) {
      const int label = rendered.labels(u, v);
      if (label == 0) continue;
      Eigen::Vector3d normal;
      const bool found = PixelNormal(view, u, v, &normal);
      if (!IsOneSide(rendered.labels, u, v, 3)) continue;
      ASSERT_TRUE(found) << u << " " << v;
      const Eigen::Vector3d truth = pose.linear().transpose() * structure.SideOfLabel(label).normal;
      EXPECT_LT((normal - truth).norm(), 1e-3) << u << " " << v;
      ++tested;
    }
  }
  EXPECT_GT(tested, 300);
}

TEST(Silhouettes, LieOnTheEdgesOfTheirSides) {
  const Rig rig = RingOfEight();
  const std::vector<SensorPoints> points = PointsOf(rig);
  for (std::size_t i = 0; i < points.size(); ++i) {
    double sum = 0;
    int count = 0;
    for (const EdgePoint& edge : points[i].edge_points) {
      const Side& side = rig.structure.SideOfLabel(edge.label);
      const Eigen::Vector3d p = *rig.frames[i].ground_truth * edge.p;
      const double distance = OutsideOfSide(rig.structure, *rig.frames[i].ground_truth, edge);
      EXPECT_LT(std::abs(side.normal.dot(p - side.centre)), 5e-3);
      EXPECT_LT(std::abs(distance), 3 * edge.sigma + 2e-3) << side.name;
      sum += distance;
      ++count;
    }
    ASSERT_GT(count, 100) << i;
    EXPECT_LT(std::abs(sum / count), 1e-3) << "silhouettes are biased";
  }
}

TEST(SidePoints, OfLabelsThatDifferALittleAreMostlyTheSame) {
  const Rig rig = RingOfEight();
  const SensorView view = MakeSensorView(rig.frames[0].depth, rig.frames[0].intrinsics);
  LabelImage labels = rig.labels[0];
  const auto sampled = [&] {
    std::vector<std::array<double, 3>> points;
    RefineOptions options;
    options.max_side_points = 1000;
    for (const SidePoint& point :
         SamplePoints(view, Certain(labels), rig.structure, options).side_points)
      points.push_back({point.p.x(), point.p.y(), point.p.z()});
    std::sort(points.begin(), points.end());
    return points;
  };
  const auto before = sampled();
  for (int v = 0; v < labels.height(); ++v)
    labels(v * 7 % labels.width(), v) = 0;  // one pixel of each row
  const auto after = sampled();
  std::vector<std::array<double, 3>> same;
  std::set_intersection(before.begin(), before.end(), after.begin(), after.end(),
                        std::back_inserter(same));
  EXPECT_GT(before.size(), 500u);
  EXPECT_GT(same.size(), before.size() * 97 / 100);
}

/// The frame as a matcher would give it: what is nearer covers the pixels next to it, too.
void GrowForeground(DepthImage* depth, LabelImage* labels) {
  const DepthImage before = *depth;
  const LabelImage sides = *labels;
  for (int v = 1; v + 1 < depth->height(); ++v) {
    for (int u = 1; u + 1 < depth->width(); ++u) {
      for (const auto& [x, y] : {std::pair(u - 1, v), {u + 1, v}, {u, v - 1}, {u, v + 1}}) {
        if (before(x, y) == 0 || before(x, y) > (*depth)(u, v) - 0.1F) continue;
        (*depth)(u, v) = before(x, y);
        (*labels)(u, v) = sides(x, y);
      }
    }
  }
}

TEST(SidePoints, OfAStereoPairSayWhereItsMatcherAddsSome) {
  const Rig rig = RingOfEight();
  for (const bool stereo : {true, false}) {
    std::size_t points = 0, off = 0;
    for (std::size_t i = 0; i < rig.frames.size(); ++i) {
      DepthImage depth = rig.frames[i].depth;
      LabelImage labels = rig.labels[i];
      GrowForeground(&depth, &labels);
      const SensorView view =
          MakeSensorView(depth, rig.frames[i].intrinsics,
                         ErrorsOf(stereo ? "realsense_d415" : "azure_kinect_nfov_binned"));
      const SensorPoints sampled =
          SamplePoints(view, Certain(labels), rig.structure, RefineOptions());
      for (const SidePoint& point : sampled.side_points) {
        const Side& side = rig.structure.SideOfLabel(point.label);
        const Eigen::Vector3d p = *rig.frames[i].ground_truth * point.p;
        if (point.lateral_sigma_rad > 0) continue;
        ++points;
        off += std::abs(side.normal.dot(p - side.centre)) > 5e-3;
      }
    }
    EXPECT_GT(points, 2000u) << stereo;
    if (stereo) {
      EXPECT_EQ(off, 0u);
    } else {
      EXPECT_GT(off, 200u);
    }
  }
}

/// A pixel that was not measured is no end of a side.
TEST(SidePoints, OfAStereoPairLieBesideHoles) {
  const Rig rig = RingOfEight();
  const auto sampled = [&](const DepthImage& depth) {
    const SensorView view =
        MakeSensorView(depth, rig.frames[0].intrinsics, ErrorsOf("realsense_d415"));
    RefineOptions all;
    all.max_side_points = static_cast<int>(depth.size());
    const SensorPoints points = SamplePoints(view, Certain(rig.labels[0]), rig.structure, all);
    return std::count_if(points.side_points.begin(), points.side_points.end(),
                         [](const SidePoint& point) { return point.lateral_sigma_rad == 0; });
  };
  DepthImage depth = rig.frames[0].depth;
  std::ptrdiff_t holes = 0;
  for (int v = 0; v < depth.height(); v += 3) {
    for (int u = v % 2; u < depth.width(); u += 3) {
      holes += depth(u, v) > 0 && rig.labels[0](u, v) > 0;
      depth(u, v) = 0;
    }
  }
  EXPECT_GT(holes, 200);
  EXPECT_GT(sampled(depth) + holes, sampled(rig.frames[0].depth) * 98 / 100);
}

// A plane that faces the sensor at 2 m ends behind column 180; after a gap, a wall at 3 m follows.
TEST(Silhouettes, LieAQuarterOfTheGapBeyondHalfAPixel) {
  for (int gap = 0; gap <= 3; ++gap) {
    DepthImage depth(320, 288, 3.0f);
    LabelImage labels(320, 288, 0);
    for (const auto [u, v] : Pixels({120, 100}, {181 + gap, 180})) {
      depth(u, v) = u <= 180 ? 2.0f : 0.0f;
      labels(u, v) = u <= 180 ? 1 : 0;
    }
    const SensorView view = MakeSensorView(depth, Kinect());
    const SegmentationResult certain = Certain(labels);
    std::size_t count = 0;
    for (const EdgePoint& edge : FindSilhouettes({view, certain, 2})) {
      if (edge.axis != 0 || edge.outward.x() < 0) continue;
      ++count;
      EXPECT_NEAR(Kinect().fx * edge.p.x() / edge.p.z() + Kinect().cx, 180.5 + 0.25 * gap, 1e-3)
          << gap;
      EXPECT_NEAR(edge.p.z(), 2, 1e-5);
      EXPECT_NEAR(edge.pixel, 2 / Kinect().fx, 1e-6);
      // Anywhere in the pixels of the gap and one more.
      EXPECT_NEAR(edge.sigma, (gap + 1) * edge.pixel / std::sqrt(12.0), 1e-6);
    }
    EXPECT_GT(count, 60u) << gap;
  }
}

// LikeliestEdge: tests/infer/calib/hypotheses_test.cc.

double Bottom(const Structure& structure, std::size_t box) {
  const Box& of = structure.boxes()[box];
  return of.structure_from_box.translation().y() - of.size.y() / 2;
}

TEST(WithEdge, AHigherBoxLiftsWhatRestsOnItAndNothingElse) {
  const Structure structure =
      Structure::FromBoxes("four", {Box::FromMinMax("low", {-0.3, 0, -0.2}, {0.3, 0.3, 0.2}),
                                    Box::FromMinMax("middle", {-0.2, 0.3, -0.1}, {0.2, 0.6, 0.1}),
                                    Box::FromMinMax("high", {-0.1, 0.6, -0.1}, {0.3, 0.8, 0.1}),
                                    Box::FromMinMax("beside", {0.4, 0, -0.2}, {0.7, 0.3, 0.2})});
  const Structure higher = WithEdge(structure, 1, 1, 0.02);
  EXPECT_NEAR(Bottom(higher, 0), 0, 1e-12);
  EXPECT_NEAR(Bottom(higher, 1), 0.3, 1e-12);
  EXPECT_NEAR(higher.boxes()[1].size.y(), 0.32, 1e-12);
  EXPECT_NEAR(Bottom(higher, 2), 0.62, 1e-12);
  EXPECT_NEAR(Bottom(higher, 3), 0, 1e-12);
  const Structure lowest = WithEdge(structure, 0, 1, -0.02);
  EXPECT_NEAR(Bottom(lowest, 2), 0.58, 1e-12);
  const Structure wider = WithEdge(structure, 0, 2, 0.02);
  EXPECT_NEAR(wider.boxes()[0].size.z(), 0.42, 1e-12);
  EXPECT_TRUE(
      wider.boxes()[0].structure_from_box.isApprox(structure.boxes()[0].structure_from_box));
  EXPECT_NEAR(Bottom(wider, 1), 0.3, 1e-12);
  EXPECT_EQ(wider.SideNames(), structure.SideNames());
}

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
  const Structure structure = PaperStructure();
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
  const Rig rig = RingOfEight();
  const std::vector<SensorPoints> points = PointsOf(rig);
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
  const Rig rig = RingOfEight();
  const std::vector<SensorPoints> points = PointsOf(rig);
  for (const std::size_t size : {std::size_t{1}, std::size_t{3}, std::size_t{8}}) {
    std::vector<FrameInput> frames;
    for (std::size_t i = 0; i < size; ++i) {
      const Pose& pose = *rig.frames[i].ground_truth;
      frames.push_back({Borrowed(points[i]), pose});
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
  const Rig rig = RingOfEight();
  const std::vector<SensorPoints> points = PointsOf(rig);
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
  TwoSensors two(Strip(true, 2), Strip(true, 2));
  SensorLens lens;
  for (const char* kind : {"realsense_d415", "kinect_v1", "azure_kinect"}) {
    lens.sensor = kind;
    const JointProblem problem(two.structure, two.frames, two.options, {lens});
    const FreeSet free = AskedFor({}, problem.priors, 2);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, GatherObservations(problem, two.state, free, {}), {0, 0}, two.state);
    ASSERT_EQ(overlaps.size(), 1u);
    const PairMatch& match = overlaps[0].of_a.at(0);
    const double expected = SigmaOfPair(match.point->p, ErrorsOf("").smooth_m);
    EXPECT_NEAR(match.sigma, expected, 0.02 * expected) << kind;
  }
}

TEST(FindOverlaps, SaysHowManyMeasurementsTheMatchesAreAndHowFarTheySpread) {
  // 60 matches in four cells of the errors, all of them 20 mm off.
  constexpr double kApart = 0.02;  // m
  const TwoSensors two(Strip(true, 2), Strip(true, 2 + kApart));
  const std::vector<PairOverlap> overlaps =
      FindOverlaps(two.Problem(), TwoFrames(), {0, 0}, two.state);
  ASSERT_EQ(overlaps.size(), 1u);
  EXPECT_EQ(overlaps[0].of_a.size(), 30u);
  EXPECT_EQ(overlaps[0].of_b.size(), 30u);
  EXPECT_NEAR(overlaps[0].cells, 4, 0.1);
  for (const PairMatch& match : overlaps[0].of_a) EXPECT_NEAR(match.residual, kApart, 1e-9);
  // The median of the sizes is that of a point halfway along.
  const double median = kApart / SigmaOfPair({0.6, 0.06, 2});
  EXPECT_NEAR(overlaps[0].excess, 1.4826 * median, 0.1 * median);
}

TEST(FindOverlaps, CountsWhatManyFramesSeeOnce) {
  const TwoSensors two(Strip(true, 2), Strip(true, 2));
  for (const std::size_t n : {2, 3, 5}) {
    const std::vector<FrameInput> frames(n, two.frames[0]);
    const JointProblem problem(two.structure, frames, two.options);
    const State state = NominalState(two.structure, std::vector<Pose>(n, two.pose));
    const std::vector<FrameObservations> observed(n, TwoFrames()[0]);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, observed, std::vector<char>(n, 0), state);
    ASSERT_EQ(overlaps.size(), n * (n - 1) / 2);
    for (const PairOverlap& pair : overlaps)
      EXPECT_NEAR(pair.cells, 4 * 2.0 / static_cast<double>(n), 0.1);
  }
}

TEST(FindOverlaps, LeavesOutAHeldFrame) {
  Neighbours made;
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
  const Structure structure = PaperStructure();
  const int label = LabelOf(structure, "top/front");
  const Side& side = structure.SideOfLabel(label);
  const FrameState sensor{RingPose(0), 0, 0};
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
}  // namespace volalign::refine_internal::observations_test
