#include "infer/checks/verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "infer/checks/outcome.h"
#include "tests/core/base/expect_error.h"

namespace volalign::verdict_test {
namespace {

/// Of a sensor that is ok, at the very limits of the defaults.
VerdictFacts AtTheLimits() {
  VerdictFacts facts;
  facts.quality.points = 1000;
  facts.quality.rms_to_structure_m = 0.02;
  facts.quality.inlier_share = 0.9;
  facts.quality.label_iou = 0.5;
  facts.covariance.diagonal().head<3>().setConstant(0.0199 * 0.0199);
  facts.covariance.diagonal().tail<3>().setConstant(std::pow(1.49 * M_PI / 180, 2));
  return facts;
}

TEST(FindWeakness, NothingAtTheLimits) {
  EXPECT_FALSE(FindWeakness(AtTheLimits(), VerdictOptions()).has_value());
}

TEST(FindWeakness, EachLimitHasItsCodeAndTheMostTellingComesFirst) {
  struct Case {
    SensorCode code;
    std::function<void(VerdictFacts*)> spoil;
    std::string words;
  };
  // From the least telling on: each spoils what those before have spoiled already, and prevails.
  const std::vector<Case> cases = {
      {SensorCode::kUncertain, [](VerdictFacts* e) { e->covariance(5, 5) = 0.01; }, "5.73 deg"},
      {SensorCode::kUncertain, [](VerdictFacts* e) { e->covariance(1, 1) = 0.0016; }, "40.0 mm"},
      {SensorCode::kLabelsDisagree, [](VerdictFacts* e) { e->quality.label_iou = 0.49; }, "49 %"},
      {SensorCode::kLargeResidual, [](VerdictFacts* e) { e->quality.rms_to_structure_m = 0.0201; },
       "20.1 mm"},
      {SensorCode::kFewInliers, [](VerdictFacts* e) { e->quality.inlier_share = 0.89; }, "89 %"},
      {SensorCode::kUnsettled, [](VerdictFacts* e) { e->unsettled = "it moved by 5 mm"; },
       "has not settled: it moved by 5 mm"},
      {SensorCode::kDisagrees,
       [](VerdictFacts* e) {
         e->contradiction = ContradictedSensors{{"S4", "S1"}, {0.0174, 0.61}};
       },
       "its pairs with S4, S1 show: they would move it by 17.4 mm and 0.61 deg"},
      {SensorCode::kAmbiguous,
       [](VerdictFacts* e) {
         e->free_space_violation = FreeSpaceViolation{1, "S2", 0.12, -std::log(500.0)};
       },
       "it and S2 cannot both be right: one of the two looks through 12 %"},
      {SensorCode::kAmbiguous, [](VerdictFacts* e) { e->other_pose = "upside down"; },
       "upside down"},
      {SensorCode::kByNeighbours,
       [](VerdictFacts* e) {
         e->by_neighbours = Finding{SensorCode::kByNeighbours, "shared with S2", "more sides"};
       },
       "shared with S2"},
      {SensorCode::kDuplicateDepth, [](VerdictFacts* e) { e->same_depth_as = "KA04"; }, "KA04"},
      {SensorCode::kUnsolved, [](VerdictFacts* e) { e->unsolved = "no solution"; }, "no solution"},
  };
  VerdictFacts facts = AtTheLimits();
  for (const Case& c : cases) {
    c.spoil(&facts);
    const std::optional<Finding> weakness = FindWeakness(facts, VerdictOptions());
    ASSERT_TRUE(weakness.has_value()) << ToString(c.code);
    EXPECT_EQ(weakness->code, c.code) << ToString(weakness->code);
    EXPECT_TRUE(Has(weakness->reason, c.words));
    EXPECT_NE(weakness->hint, "");
  }
}

// A turn about the structure's vertical moves a sensor that stands 2.3 m away.
TEST(FindWeakness, WhatCountsIsThePositionOfTheSensorItself) {
  VerdictFacts facts = AtTheLimits();
  facts.structure_from_sensor.translation() = Eigen::Vector3d(0, 0.9, 2.3);
  facts.covariance.setZero();
  facts.covariance(4, 4) = std::pow(1.1 * M_PI / 180, 2);
  const std::optional<Finding> weakness = FindWeakness(facts, VerdictOptions());
  ASSERT_TRUE(weakness.has_value());
  EXPECT_EQ(weakness->code, SensorCode::kUncertain);
  EXPECT_TRUE(Has(weakness->reason, "44.2 mm and 1.10 deg"));
  // The same turn about the sensor moves it nowhere.
  Matrix6d about_sensor = Matrix6d::Identity();
  about_sensor.topRightCorner<3, 3>() = Cross(facts.structure_from_sensor.translation());
  facts.covariance = about_sensor * facts.covariance * about_sensor.transpose();
  EXPECT_GT(SigmaTranslation(facts.covariance).maxCoeff(), 0.04);
  EXPECT_FALSE(FindWeakness(facts, VerdictOptions()).has_value());
}

TEST(FindWeakness, WhatCountsIsTheAxisThatIsKnownLeast) {
  // 1.2 deg about each axis, or 16 mm along each, but of one turn or shift, oblique to all.
  const Eigen::Vector3d oblique(1, 1, -1);
  for (const bool rotation : {false, true}) {
    VerdictFacts facts = AtTheLimits();
    const double each = rotation ? 1.2 * M_PI / 180 : 0.016;
    facts.covariance.setZero();
    facts.covariance.block<3, 3>(rotation ? 3 : 0, rotation ? 3 : 0) =
        each * each * oblique * oblique.transpose();
    const std::optional<Finding> weakness = FindWeakness(facts, VerdictOptions());
    ASSERT_TRUE(weakness.has_value());
    EXPECT_TRUE(Has(weakness->reason, rotation ? "2.08 deg" : "27.7 mm"));
  }
}

TEST(FindWeakness, FoundByGeometryAloneAndOtherBoxesCouldLookSo) {
  VerdictFacts facts = AtTheLimits();
  facts.shape_log_odds = std::log(101);
  EXPECT_FALSE(FindWeakness(facts, VerdictOptions()).has_value());
  facts.shape_log_odds = std::log(40);
  const std::optional<Finding> weakness = FindWeakness(facts, VerdictOptions());
  ASSERT_TRUE(weakness.has_value());
  EXPECT_EQ(weakness->code, SensorCode::kAmbiguous);
  EXPECT_TRUE(Has(weakness->reason, "only 40 : 1"));
}

TEST(FindWeakness, AnUncertaintyThatIsNoNumberIsUncertain) {
  VerdictFacts facts = AtTheLimits();
  facts.covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  const std::optional<Finding> weakness = FindWeakness(facts, VerdictOptions());
  ASSERT_TRUE(weakness.has_value());
  EXPECT_EQ(weakness->code, SensorCode::kUncertain);
}

TEST(FindDuplicates, NamesSensorsInOnePlaceWithOneDirection) {
  Pose a = Pose::Identity(), near = Pose::Identity(), turned = Pose::Identity();
  near.translation().x() = 0.019;
  turned.linear() = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const auto duplicates = FindDuplicates({"A", "B", "C", "D"}, {a, near, turned, std::nullopt});
  ASSERT_TRUE(duplicates[0].has_value());
  EXPECT_EQ(duplicates[0]->code, SensorCode::kSamePose);
  EXPECT_TRUE(Has(duplicates[0]->reason, "where B stands, within 19.0 mm"));
  ASSERT_TRUE(duplicates[1].has_value());
  EXPECT_TRUE(Has(duplicates[1]->reason, "where A stands"));
  EXPECT_FALSE(duplicates[2].has_value());  // the same place, another direction
  EXPECT_FALSE(duplicates[3].has_value());  // not placed
}

// Files of earlier versions have these words.
TEST(SensorCode, HasTheWordsOfTheFiles) {
  std::string words;
  for (const SensorCode code : AllOf(SensorCode())) words += std::string(ToString(code)) + " ";
  EXPECT_EQ(words,
            " no_depth wrong_units no_structure degenerate_sides inconsistent assembly_mirrored "
            "assembly_turned assembly_swapped assembly_missing assembly_shifted assembly_height "
            "frame_mirrored unconnected duplicate_depth intrinsics_suspect disagrees ambiguous "
            "not_finite unsolved unsettled "
            "same_pose by_neighbours few_inliers large_residual labels_disagree lens_suspect "
            "uncertain typical_intrinsics ");
}

}  // namespace
}  // namespace volalign::verdict_test
