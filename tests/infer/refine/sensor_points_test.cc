#include "infer/refine/sensor_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::sensor_points_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::PointsOf;
using testing_infer::Rig;
using testing_infer::RingOfEight;
using testing_infer::RingPose;

TEST(PixelNormals, AreTheFacesOwn) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const auto rendered = testing_infer::Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  int tested = 0;
  for (int v = 4; v < view.height() - 4; v += 3) {
    for (int u = 4; u < view.width() - 4; u += 3) {
      const int label = rendered.labels(u, v);
      if (label == 0) continue;
      bool whole = true;
      for (int dv = -3; dv <= 3; ++dv) {
        for (int du = -3; du <= 3; ++du) whole = whole && rendered.labels(u + du, v + dv) == label;
      }
      Eigen::Vector3d normal;
      const bool found = PixelNormal(view, u, v, 3, &normal);
      if (!whole) continue;
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
      if (edge.one_sided) continue;  // placed as if a sensor lost pixels: see silhouettes_test
      const Side& side = rig.structure.SideOfLabel(edge.label);
      const Eigen::Vector3d p = *rig.frames[i].ground_truth * edge.p;
      // Closed form: signed distance from the nearest of the rectangle's four edge lines.
      const double du = std::abs(side.axis_u.dot(p - side.centre)) - side.half_u;
      const double dv = std::abs(side.axis_v.dot(p - side.centre)) - side.half_v;
      const double distance = std::abs(du) < std::abs(dv) ? du : dv;
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
         SamplePoints(view, testing_infer::Certain(labels), rig.structure, options, 0.5)
             .side_points)
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
          SamplePoints(view, testing_infer::Certain(labels), rig.structure, RefineOptions(), 0.5);
      for (const SidePoint& point : sampled.side_points) {
        const Side& side = rig.structure.SideOfLabel(point.label);
        const Eigen::Vector3d p = *rig.frames[i].ground_truth * point.p;
        if (point.aside_rad > 0) continue;
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
    const SensorPoints points =
        SamplePoints(view, testing_infer::Certain(rig.labels[0]), rig.structure, all, 0.5);
    return std::count_if(points.side_points.begin(), points.side_points.end(),
                         [](const SidePoint& point) { return point.aside_rad == 0; });
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

}  // namespace
}  // namespace volalign::sensor_points_test
