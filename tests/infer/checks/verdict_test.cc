#include "infer/checks/verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include "infer/checks/hints.h"
#include "infer/checks/outcome.h"
#include "infer/checks/rig_findings.h"
#include "infer/checks/verification.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

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

using namespace testing_infer;

SidePatch Patch(double area, double confidence) {
  SidePatch patch;
  patch.area = area;
  patch.mean_confidence = confidence;
  return patch;
}

/// Of a sensor whose pose is just good enough, by the defaults: three sides of three directions,
/// and pixels at the limits.
struct PoseAtTheLimits {
  Structure structure = PaperStructure();
  InitialPose initial;
  LocateFacts facts;

  PoseAtTheLimits() {
    facts.initial = &initial;
    facts.explanation.causes = {17, 60, 3, 60};
    facts.explanation.named_so = 17;
    facts.explanation.named_otherwise = 3;
    for (const char* name : {"bottom/front", "mid_bottom/right", "top/up"})
      facts.confirmed.push_back(LabelOf(structure, name));
    facts.sigma_position_m = 0.25;
  }
  /// Four sides that the network is sure of, 0.6 m^2 together.
  void SeeManySides() { initial.patches.assign(4, Patch(0.15, 0.9)); }
  std::optional<Finding> Verify() const {
    return VerifyOwnPose(facts, structure, VerdictOptions());
  }
};

// In cells of which the figures for recorded frames (infer/depth/explain_view.cc) make odds for a
// wrong pose: by depths from just below 100 : 1 to just above, by labels from 1 : 100 to above
// 100 : 1.
void SeeThrough(LocateFacts* facts) { facts->explanation.causes = {16, 60, 4, 60}; }
void NameOtherwise(LocateFacts* facts) {
  facts->explanation.named_so = 3;
  facts->explanation.named_otherwise = 17;
}

TEST(VerifyOwnPose, NothingIsSaidAtTheLimits) {
  EXPECT_FALSE(PoseAtTheLimits().Verify().has_value());
}

TEST(VerifyOwnPose, EveryLimitCounts) {
  struct Case {
    SensorCode code;
    std::function<void(LocateFacts*)> spoil;
    std::string words;
  };
  const std::vector<Case> cases = {
      {SensorCode::kNoStructure, SeeThrough, "the sensor looks through 20 %"},
      {SensorCode::kNoStructure, NameOtherwise, "15 % of the labelled pixels lie on"},
      {SensorCode::kDegenerateSides, [](LocateFacts* e) { e->confirmed.resize(2); },
       "2 sides were found"},
      {SensorCode::kDegenerateSides, [](LocateFacts* e) { e->confirmed.resize(1); },
       "1 side was found"},
      {SensorCode::kDegenerateSides, [](LocateFacts* e) { e->sigma_position_m = 0.26; },
       "only to 0.26 m"},
      {SensorCode::kDegenerateSides,
       [](LocateFacts* e) { e->sigma_position_m = std::numeric_limits<double>::quiet_NaN(); },
       "3 sides were found"},
  };
  for (const Case& c : cases) {
    PoseAtTheLimits sensor;
    c.spoil(&sensor.facts);
    const std::optional<Finding> finding = sensor.Verify();
    ASSERT_TRUE(finding.has_value()) << c.words;
    EXPECT_EQ(finding->code, c.code) << finding->reason;
    EXPECT_TRUE(Has(finding->reason, c.words));
    EXPECT_EQ(finding->hint, kLookHint);
  }
}

TEST(VerifyOwnPose, ManySidesThatDoNotFitAreInconsistent) {
  for (const auto& spoil : {SeeThrough, NameOtherwise}) {
    PoseAtTheLimits sensor;
    spoil(&sensor.facts);
    EXPECT_EQ(sensor.Verify()->code, SensorCode::kNoStructure);
    sensor.SeeManySides();
    EXPECT_EQ(sensor.Verify()->code, SensorCode::kInconsistent);
    // Neither depths nor labels fit: something else is in the room.
    SeeThrough(&sensor.facts);
    NameOtherwise(&sensor.facts);
    EXPECT_EQ(sensor.Verify()->code, SensorCode::kNoStructure);
  }
}

TEST(VerifyOwnPose, DepthsAndLabelsTogetherHaveToSpeakForThePose) {
  PoseAtTheLimits sensor;
  ViewExplanation& view = sensor.facts.explanation;
  EXPECT_FALSE(IsRefuted(view));
  view.named_so = 15;
  view.named_otherwise = 5;
  ASSERT_GT(view.LogOddsByLabels(), 0);
  ASSERT_GT(view.LogOddsByDepth(), -std::log(kDecisiveOdds));
  EXPECT_TRUE(IsRefuted(view));
  view.named_so = view.named_otherwise = 0;
  EXPECT_FALSE(IsRefuted(view)) << "depths alone have to have odds of 100";
}

TEST(SeesManySides, CountsSidesThatTheNetworkIsSureOf) {
  EXPECT_TRUE(SeesManySides(std::vector<SidePatch>(4, Patch(0.13, 0.8))));
  EXPECT_FALSE(SeesManySides(std::vector<SidePatch>(3, Patch(0.3, 0.8))));
  EXPECT_FALSE(SeesManySides(std::vector<SidePatch>(4, Patch(0.12, 0.8))));
  EXPECT_FALSE(SeesManySides(std::vector<SidePatch>(9, Patch(0.3, 0.79))));
  const SureSides sure = CountSureSides({Patch(0.2, 0.9), Patch(4, 0.5), Patch(0.1, 0.8)});
  EXPECT_EQ(sure.count, 2u);
  EXPECT_NEAR(sure.area, 0.3, 1e-12);
}

TEST(ExplainMissingPose, SidesThatTheNetworkIsNotSureOfAreNone) {
  InitialPose initial;
  initial.patches = {Patch(0.06, 0.9)};
  EXPECT_EQ(ExplainMissingPose(initial).code, SensorCode::kDegenerateSides);
  initial.patches = {Patch(0.04, 0.9)};
  EXPECT_EQ(ExplainMissingPose(initial).code, SensorCode::kNoStructure);
  initial.patches = {Patch(0.6, 0.7)};
  EXPECT_EQ(ExplainMissingPose(initial).code, SensorCode::kNoStructure);
}

/// Labels in a rectangle of a 64x48 image.
LabelImage Marked(int u0, int u1, int v0, int v1) {
  LabelImage labels(64, 48);
  for (const auto [u, v] : Pixels({u0, v0}, {u1, v1})) labels(u, v) = 3;
  return labels;
}

TEST(MoveHint, SendsTheSensorTowardsWhatTheBorderCutsOff) {
  for (const auto& [labels, where] : {std::pair(Marked(0, 20, 15, 35), "the left border"),
                                      std::pair(Marked(20, 40, 0, 20), "the upper border"),
                                      std::pair(Marked(44, 64, 15, 35), "the right border"),
                                      std::pair(Marked(20, 40, 28, 48), "the lower border"),
                                      std::pair(Marked(0, 64, 15, 35), "move the sensor further"),
                                      std::pair(Marked(20, 40, 15, 35), "round the structure")})
    EXPECT_TRUE(Has(MoveHint(labels), where));
}

using Kind = RefinedQuantity::Kind;

Structure TwoBoxes() {
  return Structure::FromBoxes("two", {Box::FromMinMax("low", {-0.3, 0, -0.2}, {0.3, 0.3, 0.2}),
                                      Box::FromMinMax("high", {-0.2, 0.3, -0.1}, {0.2, 0.6, 0.1})});
}

std::vector<RigFinding> Explain(const RefineResult& refined) {
  return ExplainQuantities(refined, {"S0", "S1"}, TwoBoxes());
}

TEST(RefinedQuantity, IsMeasuredInItsOwnStandardDeviations) {
  // Of a prior of 5 and a posterior of 3, an estimate has a standard deviation of 4.
  EXPECT_DOUBLE_EQ((RefinedQuantity{Kind::kSize, 0, -8, 5, 3}.Sigmas()), 2);
  EXPECT_EQ((RefinedQuantity{Kind::kSize, 0, 1, 5, 6}.Sigmas()), 0);  // nothing was measured
}

TEST(RigFindings, EveryQuantityBeyondThreeSigmasHasItsOwn) {
  struct Case {
    RefinedQuantity quantity;
    RigCode code;
    std::vector<std::string> about;
    const char* words;
  };
  for (const Case& c :
       {Case{{Kind::kSize, 0, 0.02, 0.005, 0.001}, RigCode::kSizeOff, {}, "+2.0 %"},
        Case{{Kind::kBoxX, 1, -0.02, 0.004, 0.001}, RigCode::kBoxOff, {"high"}, "high along x"},
        Case{{Kind::kBoxZ, 0, 0.02, 0.004, 0.001}, RigCode::kBoxOff, {"low"}, "+20.0 mm"},
        Case{{Kind::kBoxYaw, 0, 0.05, 0.009, 0.001}, RigCode::kBoxOff, {"low"}, "turn of box low"},
        Case{{Kind::kDepthGain, 1, 0.02, 0.003, 0.001}, RigCode::kDepthOff, {"S1"}, "gain of S1"},
        Case{{Kind::kDepthOffset, 0, 0.03, 0.007, 0.001},
             RigCode::kDepthOff,
             {"S0"},
             "differences of 7.0 mm are usual"}}) {
    RefineResult refined;
    refined.quantities = {c.quantity};
    const std::vector<RigFinding> findings = Explain(refined);
    ASSERT_EQ(findings.size(), 1U) << c.words;
    EXPECT_EQ(findings[0].code, c.code);
    EXPECT_EQ(findings[0].about, c.about);
    EXPECT_TRUE(Has(findings[0].reason, c.words));
    EXPECT_FALSE(findings[0].hint.empty());
    refined.quantities[0].value /= 3;
    EXPECT_TRUE(Explain(refined).empty()) << c.words;
  }
}

TEST(RigFindings, ABoxTakesThePlaceOfTheSizeWhereItExplainsMore) {
  RefineResult refined;
  refined.quantities = {{Kind::kSize, 0, 0.02, 0.005, 0.001}};
  refined.wrong_edge = RefinedEdge{1, 1, -0.02, 0.001, 12};
  std::vector<RigFinding> findings = Explain(refined);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].code, RigCode::kBoxOff);
  EXPECT_NE(findings[0].reason.find("the height of box high is 20 mm less than described"),
            std::string::npos)
      << findings[0].reason;
  refined.wrong_edge->log_odds = -1;
  findings = Explain(refined);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].code, RigCode::kSizeOff);
}

TEST(RigFindings, ABoxThatTurnedHasTheLengthOfItsOtherEdge) {
  RefineResult refined;
  refined.wrong_edge = RefinedEdge{0, 0, -0.195, 0.002, 12};  // 600 mm, and 400 mm along z
  EXPECT_TRUE(Has(Explain(refined)[0].hint, "may be turned by 90 deg"));
  refined.wrong_edge->change = -0.05;
  EXPECT_FALSE(Has(Explain(refined)[0].hint, "turned"));
}

/// FindCoveredSides of TwoBoxes where two sensors at this height, m, see these boxes on them, too.
/// The second one's pose is given too low by `lower`, m.
std::vector<RigFinding> FindCovered(const std::vector<Box>& more, double height, double lower = 0) {
  const Structure described = TwoBoxes();
  std::vector<Box> boxes = described.boxes();
  boxes.insert(boxes.end(), more.begin(), more.end());
  testing_infer::Rig rig{Structure::FromBoxes("built", boxes), {}, {}};
  std::vector<SensorView> views;
  for (const double phi : {20.0, 140.0}) {
    rig.Add("S", testing_infer::RingPose(phi, 1.5, height, 90, {0, 0.4, 0}));
    views.push_back(MakeSensorView(rig.frames.back(), rig.frames.back().intrinsics));
  }
  Pose second = *rig.frames[1].ground_truth;
  second.translation().y() -= lower;
  return FindCoveredSides({{&views[0], *rig.frames[0].ground_truth}, {&views[1], second}},
                          described);
}

TEST(RigFindings, WhatStandsOnTheStackCoversIt) {
  const Box more = Box::FromMinMax("more", {-0.25, 0.6, -0.1}, {0.2, 0.8, 0.15});
  EXPECT_TRUE(FindCovered({}, 1.2).empty());
  const std::vector<RigFinding> findings = FindCovered({more}, 1.2);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].about, std::vector<std::string>{"high"});
  EXPECT_EQ(findings[0].reason.find("2 sensors should see high/up"), 0U) << findings[0].reason;
}

// Sensors below the top do not see the upper side, but what stands on it.
TEST(RigFindings, WhatStandsOnTheStackIsSeenFromBelow) {
  const Box more = Box::FromMinMax("more", {-0.1, 0.6, -0.08}, {0.1, 0.8, 0.08});
  EXPECT_TRUE(FindCovered({}, 0.5).empty());
  const std::vector<RigFinding> findings = FindCovered({more}, 0.5);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].about, std::vector<std::string>{"high"});
  EXPECT_EQ(findings[0].reason, "something stands on high/up, as 2 sensors show");
  EXPECT_TRUE(FindCovered({more}, 0.5, 0.3).empty()) << "one sensor alone";
}

TEST(RigFindings, PairsFarBeyondTheirPrediction) {
  RefineResult refined;
  refined.pairs.resize(2);
  refined.pairs[0] = {0, 1, 0.3, 0.0144, 0.0036};
  refined.pairs[1] = {0, 1, 0.3, 0.0043, 0.0023};
  const std::vector<RigFinding> findings = FindPairsApart(refined, {"S0", "S1"});
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].about, (std::vector<std::string>{"S0", "S1"}));
  EXPECT_TRUE(Has(findings[0].reason, "14.4 mm RMS apart; 3.6 mm are predicted"));
}

// A depth scale that is 2 % wrong: no pair alone says it.
TEST(RigFindings, ASensorWhosePairsAreAllApart) {
  RefineResult refined;
  for (const auto& [a, b, ratio] :
       {std::tuple(0, 1, 1.7), std::tuple(0, 2, 2.1), std::tuple(0, 3, 1.6), std::tuple(1, 2, 0.7),
        std::tuple(1, 3, 0.8), std::tuple(2, 3, 0.6)})
    refined.pairs.push_back({a, b, 0.3, 0.005 * ratio, 0.005});
  const std::vector<std::string> names{"S0", "S1", "S2", "S3"};
  const std::vector<RigFinding> findings = FindPairsApart(refined, names);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_EQ(findings[0].about, std::vector<std::string>{"S0"});
  EXPECT_EQ(findings[0].reason,
            "where S0 and others see the same surface, their points are 1.6 to 2.1 times as far "
            "apart as predicted. Points of other pairs are 0.7 times as far apart on average");
  // Three sensors: the one pair without the first may be good by chance.
  RefineResult three;
  three.pairs = {refined.pairs[0], refined.pairs[1], refined.pairs[3]};
  EXPECT_TRUE(FindPairsApart(three, {"S0", "S1", "S2"}).empty());
  // Pairs without it that are apart, too.
  refined.pairs.back().rms = 0.01;
  EXPECT_TRUE(FindPairsApart(refined, names).empty());
}

}  // namespace
}  // namespace volalign::verdict_test
