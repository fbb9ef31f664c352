#include "infer/evaluate/suite/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/visibility.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::metrics_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// A frame of a few hundred pixels with gaps and wrong labels, and a pose that is a little off.
struct SmallCase {
  Structure structure = PaperStructure();
  Intrinsics intrinsics;
  Pose pose;
  SensorView view;
  LabelImage labels;

  SmallCase() {
    intrinsics = Kinect().Resized(32, 28);
    const Pose truth = RingPose(35, 2.0, 0.5, 0);
    testing_infer::SyntheticView seen = testing_infer::Render(structure, intrinsics, truth);
    RandomStream random(3, 0, "small case");
    for (std::size_t i = 0; i < seen.depth.size(); ++i) {
      if (random.Chance(0.1)) seen.depth[i] = 0;
      if (seen.depth[i] == 0) seen.labels[i] = 0;
      if (random.Chance(0.05)) seen.labels[i] = static_cast<std::uint8_t>(random.Below(21));
    }
    Vector6d delta;
    delta << 0.05, -0.03, 0.04, 0.02, -0.03, 0.01;
    pose = PerturbLeft(delta, truth);
    view = MakeSensorView(seen.depth, intrinsics);
    labels = std::move(seen.labels);
  }

  Eigen::Vector3d Ray(int u, int v) const {
    return {(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1};
  }
  /// Label of the nearest side whose rectangle the pixel's ray meets, and where: plane by plane,
  /// where core casts rays against boxes.
  int Shown(int u, int v, Eigen::Vector3d* at) const {
    const Eigen::Vector3d origin = pose.translation(), ray = pose.linear() * Ray(u, v);
    double nearest = std::numeric_limits<double>::infinity();
    int label = 0;
    for (const Side& side : structure.sides()) {
      const double t = side.normal.dot(side.centre - origin) / side.normal.dot(ray);
      const Eigen::Vector3d p = origin + t * ray;
      if (!(t > 0) || t >= nearest || std::abs(side.axis_u.dot(p - side.centre)) > side.half_u ||
          std::abs(side.axis_v.dot(p - side.centre)) > side.half_v) {
        continue;
      }
      nearest = t;
      label = side.label;
      *at = p;
    }
    return label;
  }
};

/// By sets of pixels. `all_classes`: absent ones count as 1.
double BruteForceMiou(const SmallCase& c, bool all_classes, bool all_pixels) {
  std::map<int, std::set<int>> predicted, shown;
  for (int v = 0; v < 28; ++v) {
    for (int u = 0; u < 32; ++u) {
      if (!all_pixels && !(c.view.depth(u, v) > 0)) continue;
      Eigen::Vector3d at;
      predicted[c.labels(u, v)].insert(100 * v + u);
      shown[c.Shown(u, v, &at)].insert(100 * v + u);
    }
  }
  double sum = 0;
  int count = 0;
  for (int k = 0; k < 21; ++k) {
    std::set<int> either = predicted[k];
    either.insert(shown[k].begin(), shown[k].end());
    std::size_t both = 0;
    for (const int pixel : predicted[k]) both += shown[k].count(pixel);
    if (either.empty() && !all_classes) continue;
    sum += either.empty() ? 1 : static_cast<double>(both) / static_cast<double>(either.size());
    ++count;
  }
  return sum / count;
}

TEST(PaperMetrics, MiouIsThatOfBruteForce) {
  const SmallCase c;
  const PoseScore score = ScorePose(c.view, c.labels, c.structure, c.pose, 5);
  EXPECT_NEAR(score.miou, BruteForceMiou(c, false, false), 1e-12);
  EXPECT_NEAR(score.miou_authors, BruteForceMiou(c, true, false), 1e-12);
  EXPECT_NEAR(score.miou_authors_all, BruteForceMiou(c, true, true), 1e-12);
  EXPECT_GT(score.miou_authors, score.miou);  // absent classes count as 1
  EXPECT_NE(score.miou_authors, score.miou_authors_all);
}

TEST(PaperMetrics, RmseIsThatOfBruteForce) {
  const SmallCase c;
  constexpr int kMinPixels = 5;
  double to_centre = 0, to_visible = 0;
  int sides = 0, visible = 0;
  for (const Side& side : c.structure.sides()) {
    if (side.label == 0) continue;
    std::vector<Eigen::Vector3d> seen, shown;
    for (int v = 0; v < 28; ++v) {
      for (int u = 0; u < 32; ++u) {
        Eigen::Vector3d at;
        if (c.Shown(u, v, &at) == side.label) shown.push_back(at);
        const double z = c.view.depth(u, v);
        if (z > 0 && c.labels(u, v) == side.label) seen.push_back(c.pose * (z * c.Ray(u, v)));
      }
    }
    if (seen.size() < kMinPixels) continue;
    const auto mean = [](const std::vector<Eigen::Vector3d>& points) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const Eigen::Vector3d& p : points) sum += p;
      return Eigen::Vector3d(sum / static_cast<double>(points.size()));
    };
    ++sides;
    to_centre += (mean(seen) - side.centre).squaredNorm();
    if (shown.empty()) continue;
    ++visible;
    to_visible += (mean(seen) - mean(shown)).squaredNorm();
  }
  ASSERT_GT(sides, 4);
  const PoseScore score = ScorePose(c.view, c.labels, c.structure, c.pose, kMinPixels);
  EXPECT_EQ(score.sides, sides);
  EXPECT_NEAR(score.rmse_m.value(), std::sqrt(to_centre / sides), 1e-6);  // depth is in float
  EXPECT_NEAR(score.rmse_visible_m.value(), std::sqrt(to_visible / visible), 1e-6);
  EXPECT_FALSE(ScorePose(c.view, c.labels, c.structure, c.pose, 10000).rmse_m);
}

TEST(PaperMetrics, D1AndD2AreThoseOfBruteForce) {
  const SmallCase c;
  std::vector<Eigen::Vector3d> a;
  for (int v = 0; v < 28; ++v) {
    for (int u = 0; u < 32; ++u) {
      Eigen::Vector3d at;
      if (c.Shown(u, v, &at) > 0 && c.view.depth(u, v) > 0 && c.view.depth(u, v) < 2.2)
        a.push_back(c.pose * c.view.Point(u, v));
    }
  }
  constexpr double kSpacing = 0.05;
  const std::vector<Eigen::Vector3d> b = SampleExposedSurface(c.structure, kSpacing);
  const auto dist = [](const std::vector<Eigen::Vector3d>& from,
                       const std::vector<Eigen::Vector3d>& to) {
    double sum = 0;
    for (const Eigen::Vector3d& p : from) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const Eigen::Vector3d& q : to) nearest = std::min(nearest, (p - q).squaredNorm());
      sum += nearest;
    }
    return std::sqrt(sum / static_cast<double>(from.size()));
  };
  const SetDistances d = CompareSets(a, b);
  EXPECT_NEAR(d.d1, dist(a, b), 1e-12);
  EXPECT_NEAR(d.d2, std::max(dist(a, b), dist(b, a)), 1e-12);
  EXPECT_GT(d.d2, d.d1);  // one sensor sees no side from behind
}

TEST(PaperMetrics, ColumnsHaveTheirDefinition) {
  // Two set-ups: 1 and 3, and 10 and 30.
  const ColumnStatistics column = Column({1, 10, 3, 30}, {0, 7, 0, 7});
  EXPECT_EQ(column.count, 4);
  EXPECT_DOUBLE_EQ(column.mean, 11);
  EXPECT_DOUBLE_EQ(column.std, std::sqrt((100 + 1 + 64 + 361) / 4.0));
  EXPECT_DOUBLE_EQ(column.rsd, column.std / 11);
  EXPECT_DOUBLE_EQ(column.rsd_within.value(), 0.5);
  // One value has no spread: it does not count as 0.
  EXPECT_DOUBLE_EQ(Column({1, 3, 7}, {0, 0, 1}).rsd_within.value(), 0.5);
  EXPECT_FALSE(Column({1, 3}, {0, 1}).rsd_within.has_value());
  EXPECT_EQ(Column({}, {}).count, 0);
}

// The paper's own rows: mean, STD, RSD and the distance to the best mean.
TEST(PaperMetrics, ThePapersRsdIsStdOverMeanButForTheArc) {
  struct Row {
    double mean, mean_step, std, std_step, rsd;
  };
  const std::vector<Row> rows{
      {89.47, 0.01, 7.78, 0.01, 8.7},      {0.0890, 1e-4, 0.0431, 1e-4, 48.4},
      {0.0273, 1e-4, 0.0007, 1e-4, 2.67},  {0.0262, 1e-4, 0.0007, 1e-4, 2.64},
      {0.0348, 1e-4, 0.0042, 1e-4, 12.16}, {0.0556, 1e-4, 0.0027, 1e-4, 4.87},
      {0.0288, 1e-4, 0.0008, 1e-4, 2.91},  {0.0292, 1e-4, 0.0013, 1e-4, 4.50},
      {0.0361, 1e-4, 0.0072, 1e-4, 19.90}, {0.0552, 1e-4, 0.0069, 1e-4, 12.51}};
  // Two values that have this mean and this deviation, both rounded as printed.
  const auto consistent = [](const Row& row) {
    const auto rsd = [&](double mean, double std) {
      return 100 * Column({mean - std, mean + std}, {0, 1}).rsd;
    };
    return rsd(row.mean + row.mean_step / 2, row.std - row.std_step / 2) - 0.05 <= row.rsd &&
           row.rsd <= rsd(row.mean - row.mean_step / 2, row.std + row.std_step / 2) + 0.05;
  };
  for (const Row& row : rows) EXPECT_TRUE(consistent(row)) << row.rsd;
  const std::vector<Row> arc{{0.0136, 1e-4, 0.0028, 1e-4, 3.76},
                             {0.0142, 1e-4, 0.0034, 1e-4, 4.91},
                             {0.0378, 1e-4, 0.0122, 1e-4, 10.36},
                             {0.0579, 1e-4, 0.0126, 1e-4, 9.06}};
  for (const Row& row : arc) EXPECT_FALSE(consistent(row)) << row.rsd;
}

}  // namespace
}  // namespace volalign::metrics_test
