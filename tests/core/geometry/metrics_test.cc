#include "core/geometry/metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "core/base/error.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"

namespace volalign::metrics_test {
namespace {

LabelImage RandomLabels(RandomStream& random, int width, int height, int classes) {
  LabelImage image(width, height);
  for (auto& x : image) x = static_cast<std::uint8_t>(random.Below(classes));
  return image;
}

/// Sets of pixels per class, intersected and united as the definition says.
double BruteForceIou(const LabelImage& a, const LabelImage& b, const DepthImage& depth, int classes,
                     bool absent_counts) {
  std::vector<double> ious;
  for (int k = 0; k < classes; ++k) {
    std::set<std::size_t> in_a, in_b, both, either;
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (!depth.empty() && depth[i] <= 0) continue;
      if (a[i] == k) in_a.insert(i);
      if (b[i] == k) in_b.insert(i);
    }
    std::set_intersection(in_a.begin(), in_a.end(), in_b.begin(), in_b.end(),
                          std::inserter(both, both.end()));
    std::set_union(in_a.begin(), in_a.end(), in_b.begin(), in_b.end(),
                   std::inserter(either, either.end()));
    if (!either.empty()) {
      ious.push_back(static_cast<double>(both.size()) / static_cast<double>(either.size()));
    } else if (absent_counts) {
      ious.push_back(1);
    }
  }
  double sum = 0;
  for (const double x : ious) sum += x;
  return ious.empty() ? 1 : sum / static_cast<double>(ious.size());
}

TEST(MeanIou, AgreesWithBruteForce) {
  RandomStream random(1, 0, "iou");
  for (int i = 0; i < 60; ++i) {
    const int classes = 21;
    // Few classes in use, so that most are absent.
    const LabelImage a = RandomLabels(random, 13, 9, 1 + i % 6);
    LabelImage b = a;
    for (auto& x : b) {
      if (random.Chance(0.3)) x = static_cast<std::uint8_t>(random.Below(1 + i % 9));
    }
    DepthImage depth;
    if (i % 2) {
      depth = DepthImage(13, 9);
      for (auto& z : depth) z = random.Chance(0.6) ? 2.0f : 0.0f;
    }
    for (const bool absent : {false, true}) {
      EXPECT_NEAR(MeanIou(a, b, depth, {classes, absent}),
                  BruteForceIou(a, b, depth, classes, absent), 1e-12);
      EXPECT_NEAR(MeanIou(a, b, depth, {classes, absent}), MeanIou(b, a, depth, {classes, absent}),
                  1e-12);
    }
  }
}

TEST(MeanIou, ClosedForms) {
  LabelImage truth(4, 1), predicted(4, 1);
  for (std::size_t i = 0; i < 4; ++i) truth[i] = static_cast<std::uint8_t>(i / 2);  // 0 0 1 1
  predicted[2] = 1;                                                                 // 0 0 1 0
  // Class 0: 2 / 3, class 1: 1 / 2.
  EXPECT_NEAR(MeanIou(predicted, truth, {}, {5, false}), (2.0 / 3 + 0.5) / 2, 1e-15);
  EXPECT_NEAR(MeanIou(predicted, truth, {}, {5, true}), (2.0 / 3 + 0.5 + 3) / 5, 1e-15);
  // Without depth at the wrong pixel, all that counts is right.
  DepthImage depth(4, 1, 1.0f);
  depth[3] = 0;
  EXPECT_EQ(MeanIou(predicted, truth, depth, {5, false}), 1);
  depth[3] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(MeanIou(predicted, truth, depth, {5, false}), 1);
  // No pixel counts.
  EXPECT_EQ(MeanIou(predicted, truth, DepthImage(4, 1), {5, false}), 1);
  EXPECT_EQ(MeanIou(predicted, truth, DepthImage(4, 1), {5, true}), 1);
  // Wrong everywhere.
  EXPECT_EQ(MeanIou(LabelImage(4, 1, 2), LabelImage(4, 1, 3), {}, {5, false}), 0);
}

TEST(MeanIou, RejectsBadInput) {
  const LabelImage a(4, 3), b(3, 4);
  ExpectError<Error>([&] { MeanIou(a, b, {}, {21, false}); }, {"sizes"});
  ExpectError<Error>([&] { MeanIou(a, a, DepthImage(3, 4), {21, false}); }, {"sizes"});
  ExpectError<Error>([&] { MeanIou(LabelImage(4, 3, 21), a, {}, {21, false}); }, {"21"});
  ExpectError<Error>([&] { MeanIou(a, LabelImage(4, 3, 30), {}, {21, false}); }, {"30"});
}

using Points = std::vector<Eigen::Vector3d>;

Points RandomPoints(RandomStream& random, int n) {
  Points points;
  for (int i = 0; i < n; ++i)
    points.emplace_back(random.Normal(), random.Normal(), random.Normal());
  return points;
}

double BruteForceDistance(const Points& a, const Points& b) {
  double sum = 0;
  for (const auto& p : a) {
    double best = std::numeric_limits<double>::infinity();
    for (const auto& q : b) best = std::min(best, (p - q).squaredNorm());
    sum += best;
  }
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(RmsDistance, AgreesWithBruteForce) {
  RandomStream random(1, 1, "rms");
  for (const auto& [n, m] : {std::pair(1, 1), {1, 50}, {50, 1}, {300, 17}, {400, 1500}}) {
    const Points a = RandomPoints(random, n), b = RandomPoints(random, m);
    EXPECT_NEAR(RmsDistance(a, b), BruteForceDistance(a, b), 1e-12);
    const SetDistances d = CompareSets(a, b);
    EXPECT_NEAR(d.d1, BruteForceDistance(a, b), 1e-12);
    EXPECT_NEAR(d.d2, std::max(BruteForceDistance(a, b), BruteForceDistance(b, a)), 1e-12);
  }
}

TEST(RmsDistance, IsTheSameOnAnyNumberOfThreads) {
  RandomStream random(1, 3, "rms");
  const Points a = RandomPoints(random, 9000), b = RandomPoints(random, 20);
  EXPECT_NEAR(RmsDistance(a, b, 3), BruteForceDistance(a, b), 1e-12);
  EXPECT_EQ(RmsDistance(a, b, 3), RmsDistance(a, b, 1));
}

TEST(RmsDistance, RepeatedPointsAndSubsets) {
  const Points b(100, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(RmsDistance({{1, 2, 5}}, b), 2, 1e-15);
  RandomStream random(1, 2, "rms");
  const Points all = RandomPoints(random, 200), some(all.begin(), all.begin() + 20);
  EXPECT_EQ(RmsDistance(some, all), 0);
  // The distance that is not symmetric: all of the set's rest is far from its part.
  EXPECT_EQ(CompareSets(some, all).d1, 0);
  EXPECT_GT(CompareSets(some, all).d2, 0.1);
}

TEST(RmsDistance, RejectsEmptySets) {
  ExpectError<Error>([] { RmsDistance({}, {{0, 0, 0}}); }, {"empty"});
  ExpectError<Error>([] { RmsDistance({{0, 0, 0}}, {}); }, {"empty"});
}

// 1 ... n: mean (n + 1) / 2, population variance (n^2 - 1) / 12.
TEST(Summarise, ClosedForms) {
  const int n = 101;
  std::vector<double> values;
  for (int i = n; i >= 1; --i) values.push_back(i);
  const Summary summary = Summarise(values);
  EXPECT_NEAR(summary.mean, 51, 1e-12);
  EXPECT_NEAR(summary.std, std::sqrt((n * n - 1) / 12.0), 1e-12);
  EXPECT_NEAR(summary.rsd, summary.std / 51, 1e-12);
  EXPECT_NEAR(summary.median, 51, 1e-12);
  EXPECT_NEAR(summary.p95, 96, 1e-12);

  const Summary two = Summarise({3, 1});
  EXPECT_NEAR(two.mean, 2, 1e-15);
  EXPECT_NEAR(two.std, 1, 1e-15);
  EXPECT_NEAR(two.median, 2, 1e-15);
  EXPECT_NEAR(two.p95, 2.9, 1e-12);

  const Summary one = Summarise({4});
  EXPECT_EQ(one.mean, 4);
  EXPECT_EQ(one.std, 0);
  EXPECT_EQ(one.median, 4);
  EXPECT_EQ(one.p95, 4);

  const Summary none = Summarise({});
  EXPECT_EQ(none.mean, 0);
  EXPECT_EQ(none.std, 0);
  EXPECT_EQ(Summarise({-1, 1}).rsd, 0);  // no relative deviation from a mean of 0
}

}  // namespace
}  // namespace volalign::metrics_test
