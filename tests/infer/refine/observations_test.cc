#include "infer/refine/observations.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include "infer/refine/association.h"
#include "infer/refine/box_edges.h"
#include "infer/refine/sensor_points.h"
#include "infer/refine/silhouettes.h"
#include "infer/view/alike.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/refine/points_and_observations.h"
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
      const bool found = PixelNormal(view, u, v, 3, &normal);
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
         SamplePoints(view, Certain(labels), rig.structure, options, 0.5).side_points)
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
          SamplePoints(view, Certain(labels), rig.structure, RefineOptions(), 0.5);
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
    const SensorPoints points = SamplePoints(view, Certain(rig.labels[0]), rig.structure, all, 0.5);
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
    for (const EdgePoint& edge : FindSilhouettes({view, certain, 2, 0.5})) {
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

}  // namespace
}  // namespace volalign::refine_internal::observations_test
