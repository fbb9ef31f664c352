#include "infer/checks/rig_findings.h"

#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::rig_findings_test {
namespace {

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
}  // namespace volalign::rig_findings_test
