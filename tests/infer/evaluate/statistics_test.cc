#include "infer/evaluate/statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "infer/evaluate/tables.h"

namespace volalign::statistics_test {
namespace {

EvaluatedSensor Measured(double initial_mm, double refined_mm, double deg) {
  EvaluatedSensor sensor;
  sensor.name = "S";
  sensor.status = SensorStatus::kOk;
  sensor.sides_fix_pose = true;
  sensor.nominal =
      EvaluatedErrors{{initial_mm / 1000, 2 * deg}, {refined_mm / 1000, deg}, Vector6d::Zero()};
  return sensor;
}

TEST(Statistics, SummariesAreTheDefinitions) {
  EvaluatedCase ring{"", "ring", "kinect", "a", 1, {}, {}};
  for (int i = 1; i <= 21; ++i) ring.results.push_back(Measured(10 * i, i, 0.01 * i));
  EvaluatedCase arc{"", "arc", "kinect", "a", 1, {Measured(5, 150, 0.1), Measured(5, 1, 6)}, {}};
  arc.results[0].status = SensorStatus::kWeak;
  EvaluatedCase other{"", "ring", "d415", "a", 1, {Measured(7, 7, 7)}, {}};
  const std::vector<EvaluationSummary> all = SummariseCases({ring, arc, other});
  std::vector<std::string> names;
  names.reserve(all.size());
  for (const EvaluationSummary& s : all) names.push_back(s.rig + "/" + s.sensors);
  EXPECT_EQ(names, (std::vector<std::string>{"ring/kinect", "ring/d415", "arc/kinect",
                                             "all rigs/kinect", "all rigs/d415", "all rigs/all"}));
  EXPECT_NEAR(all[0].refined_mm.median, 11, 1e-9);
  EXPECT_NEAR(all[0].refined_mm.p95, 20, 1e-9);
  EXPECT_NEAR(all[0].refined_mm.max, 21, 1e-9);
  EXPECT_NEAR(all[0].initial_mm.median, 110, 1e-9);
  EXPECT_NEAR(all[0].refined_deg.max, 0.21, 1e-9);
  EXPECT_NEAR(all[0].initial_deg.max, 0.42, 1e-9);
  EXPECT_EQ(all[0].wrong, 0);
  EXPECT_EQ(all[2].wrong, 2);
  EXPECT_EQ(all[2].weak, 1);
  EXPECT_EQ(all[5].count, 24);
  EXPECT_EQ(all[5].wrong, 3);
}

TEST(Statistics, PlacementsHaveRowsOfTheirOwn) {
  EvaluatedCase one{"", "ring", "kinect", "a", 1, {Measured(9, 4, 0.1)}, {}};
  EvaluatedCase four = one;
  four.placements = 4;
  four.results[0] = Measured(9, 2, 0.1);
  EXPECT_EQ(FormatEvaluation({one}).find("| placements |"), std::string::npos);
  const std::vector<EvaluationSummary> all = SummariseCases({one, four});
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].placements, 1);
  EXPECT_NEAR(all[0].refined_mm.median, 4, 1e-9);
  EXPECT_EQ(all[1].placements, 4);
  EXPECT_NEAR(all[1].refined_mm.median, 2, 1e-9);
  const std::string text = FormatEvaluation({one, four});
  EXPECT_NE(text.find("| rig | sensors | placements | variant | initial"), std::string::npos);
  EXPECT_NE(text.find("| ring | kinect | 4 | a | 9.0"), std::string::npos) << text;
  EXPECT_NE(text.find("| ring | kinect | 4 | a | 1 of 1 |"), std::string::npos) << text;
  // A row and its head have as many columns.
  for (const char* head : {"| rig | sensors | placements | variant | initial",
                           "| rig | sensors | placements | variant | placed"}) {
    const std::size_t begin = text.find(head);
    std::vector<long> columns;
    for (std::size_t line = begin; columns.size() < 4; line = text.find('\n', line) + 1) {
      columns.push_back(std::count(text.begin() + static_cast<long>(line),
                                   text.begin() + static_cast<long>(text.find('\n', line)), '|'));
    }
    EXPECT_EQ(columns, std::vector<long>(4, columns[0])) << head;
  }
}

TEST(Statistics, IntervalsOfNormalErrorsCoverWhatTheySay) {
  RandomStream random(3, 0, "evaluate_test");
  EvaluatedCase one{"", "ring", "kinect", "a", 1, {}, {}};
  for (int i = 0; i < 4000; ++i) {
    EvaluatedSensor sensor = Measured(1, 1, 1);
    sensor.built = sensor.nominal;
    for (int j = 0; j < 6; ++j) {
      sensor.sigma[j] = 0.001 * (j + 1);
      sensor.nominal->delta[j] = random.Normal(0, sensor.sigma[j]);
      sensor.built->delta[j] = 2 * sensor.nominal->delta[j];
    }
    one.results.push_back(sensor);
  }
  const EvaluationSummary summary = SummariseCases({one}).at(0);
  EXPECT_NEAR(summary.cover68, 0.68, 0.01);
  EXPECT_NEAR(summary.cover95, 0.95, 0.005);
  // P(|z| < 0.4972) and P(|z| < 0.98) of the standard normal.
  EXPECT_NEAR(summary.built_cover68, 0.381, 0.01);
  EXPECT_NEAR(summary.built_cover95, 0.673, 0.01);
}

}  // namespace
}  // namespace volalign::statistics_test
