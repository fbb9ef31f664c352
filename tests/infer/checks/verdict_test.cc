#include "infer/checks/verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace volalign {
namespace {

/// Of a sensor that is ok, at the very limits of the defaults.
PlacedEvidence AtTheLimits() {
  PlacedEvidence evidence;
  evidence.quality.surface = {1000, 0.02, 0.9};
  evidence.quality.label_iou = 0.5;
  evidence.covariance.diagonal().head<3>().setConstant(0.0199 * 0.0199);
  evidence.covariance.diagonal().tail<3>().setConstant(std::pow(1.49 * M_PI / 180, 2));
  return evidence;
}

TEST(FindWeakness, NothingAtTheLimits) {
  EXPECT_FALSE(FindWeakness(AtTheLimits(), VerdictOptions()).has_value());
}

TEST(FindWeakness, EachLimitHasItsCodeAndTheMostTellingComesFirst) {
  struct Case {
    SensorCode code;
    std::function<void(PlacedEvidence*)> spoil;
    std::string words;
  };
  // From the least telling on: each spoils what those before have spoiled already, and prevails.
  const std::vector<Case> cases = {
      {SensorCode::kUncertain, [](PlacedEvidence* e) { e->covariance(5, 5) = 0.01; }, "5.73 deg"},
      {SensorCode::kUncertain, [](PlacedEvidence* e) { e->covariance(1, 1) = 0.0016; }, "40.0 mm"},
      {SensorCode::kLabelsDisagree, [](PlacedEvidence* e) { e->quality.label_iou = 0.49; }, "49 %"},
      {SensorCode::kLargeResidual, [](PlacedEvidence* e) { e->quality.surface.rms_m = 0.0201; },
       "20.1 mm"},
      {SensorCode::kFewInliers, [](PlacedEvidence* e) { e->quality.surface.inlier_share = 0.89; },
       "89 %"},
      {SensorCode::kDisagrees,
       [](PlacedEvidence* e) {
         e->contradiction = ContradictedSensors{{"S4", "S1"}, {0.0174, 0.61}};
       },
       "its pairs with S4, S1 show: they would move it by 17.4 mm and 0.61 deg"},
      {SensorCode::kAmbiguous, [](PlacedEvidence* e) { e->other_pose = "upside down"; },
       "upside down"},
      {SensorCode::kByNeighbours,
       [](PlacedEvidence* e) {
         e->by_neighbours = Finding{SensorCode::kByNeighbours, "shared with S2", "more sides"};
       },
       "shared with S2"},
      {SensorCode::kIntrinsicsSuspect,
       [](PlacedEvidence* e) {
         e->suspect_intrinsics = Finding{SensorCode::kIntrinsicsSuspect, "fx = 300", "hint"};
       },
       "fx = 300"},
      {SensorCode::kDuplicateDepth, [](PlacedEvidence* e) { e->same_depth_as = "KA04"; }, "KA04"},
      {SensorCode::kUnsolved, [](PlacedEvidence* e) { e->unsolved = "no solution"; },
       "no solution"},
  };
  PlacedEvidence evidence = AtTheLimits();
  for (const Case& c : cases) {
    c.spoil(&evidence);
    const std::optional<Finding> weakness = FindWeakness(evidence, VerdictOptions());
    ASSERT_TRUE(weakness.has_value()) << ToString(c.code);
    EXPECT_EQ(weakness->code, c.code) << ToString(weakness->code);
    EXPECT_NE(weakness->reason.find(c.words), std::string::npos) << weakness->reason;
    EXPECT_NE(weakness->hint, "");
  }
}

// A turn about the structure's vertical moves a sensor that stands 2.3 m away.
TEST(FindWeakness, WhatCountsIsThePositionOfTheSensorItself) {
  PlacedEvidence evidence = AtTheLimits();
  evidence.structure_from_sensor.translation() = Eigen::Vector3d(0, 0.9, 2.3);
  evidence.covariance.setZero();
  evidence.covariance(4, 4) = std::pow(1.1 * M_PI / 180, 2);
  const std::optional<Finding> weakness = FindWeakness(evidence, VerdictOptions());
  ASSERT_TRUE(weakness.has_value());
  EXPECT_EQ(weakness->code, SensorCode::kUncertain);
  EXPECT_NE(weakness->reason.find("44.2 mm and 1.10 deg"), std::string::npos) << weakness->reason;
  // The same turn about the sensor moves it nowhere.
  Matrix6d about_sensor = Matrix6d::Identity();
  about_sensor.topRightCorner<3, 3>() = Cross(evidence.structure_from_sensor.translation());
  evidence.covariance = about_sensor * evidence.covariance * about_sensor.transpose();
  EXPECT_GT(SigmaTranslation(evidence.covariance).maxCoeff(), 0.04);
  EXPECT_FALSE(FindWeakness(evidence, VerdictOptions()).has_value());
}

TEST(FindWeakness, HalfHiddenAndFoundByGeometryAlone) {
  PlacedEvidence evidence = AtTheLimits();
  evidence.visible_by_geometry = VerdictOptions().weak_visible_share;
  EXPECT_FALSE(FindWeakness(evidence, VerdictOptions()).has_value());
  evidence.visible_by_geometry = 0.6;
  const std::optional<Finding> weakness = FindWeakness(evidence, VerdictOptions());
  ASSERT_TRUE(weakness.has_value());
  EXPECT_EQ(weakness->code, SensorCode::kAmbiguous);
  EXPECT_NE(weakness->reason.find("hides 40 %"), std::string::npos) << weakness->reason;
}

TEST(FindWeakness, AnUncertaintyThatIsNoNumberIsUncertain) {
  PlacedEvidence evidence = AtTheLimits();
  evidence.covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  const std::optional<Finding> weakness = FindWeakness(evidence, VerdictOptions());
  ASSERT_TRUE(weakness.has_value());
  EXPECT_EQ(weakness->code, SensorCode::kUncertain);
}

TEST(FindWeakness, TurnsAreAskedForOnlyWhereTheyAreNotGiven) {
  PlacedEvidence evidence = AtTheLimits();
  evidence.other_pose = "upside down";
  EXPECT_NE(FindWeakness(evidence, VerdictOptions())->hint.find("quarter_turns"),
            std::string::npos);
  evidence.known_turns = true;
  EXPECT_EQ(FindWeakness(evidence, VerdictOptions())->hint.find("quarter_turns"),
            std::string::npos);
}

TEST(FindTwins, NamesSensorsInOnePlaceWithOneDirection) {
  Pose a = Pose::Identity(), near = Pose::Identity(), turned = Pose::Identity();
  near.translation().x() = 0.019;
  turned.linear() = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const auto twins =
      FindTwins({"A", "B", "C", "D"}, {a, near, turned, std::nullopt}, VerdictOptions());
  ASSERT_TRUE(twins[0].has_value());
  EXPECT_EQ(twins[0]->code, SensorCode::kSamePose);
  EXPECT_NE(twins[0]->reason.find("where B stands, to 19.0 mm"), std::string::npos)
      << twins[0]->reason;
  ASSERT_TRUE(twins[1].has_value());
  EXPECT_NE(twins[1]->reason.find("where A stands"), std::string::npos);
  EXPECT_FALSE(twins[2].has_value());  // the same place, another direction
  EXPECT_FALSE(twins[3].has_value());  // not placed
}

}  // namespace
}  // namespace volalign
