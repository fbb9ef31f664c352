#include "infer/refine/sensor_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
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
    SamplingOptions options;
    options.max_side_points = 1000;
    for (const SidePoint& point :
         SamplePoints(view, testing_infer::Certain(labels), rig.structure, options).side_points)
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

}  // namespace
}  // namespace volalign::sensor_points_test
