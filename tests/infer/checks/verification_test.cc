#include "infer/checks/verification.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "infer/checks/hints.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::verification_test {
namespace {

using namespace testing_infer;

SidePatch Patch(double area, double confidence) {
  SidePatch patch;
  patch.area = area;
  patch.mean_confidence = confidence;
  return patch;
}

/// Of a sensor whose pose is just good enough, by the defaults: three sides of three directions,
/// and pixels at the limits.
struct AtTheLimits {
  Structure structure = PaperStructure();
  InitialPose initial;
  LocateFacts facts;

  AtTheLimits() {
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

TEST(VerifyOwnPose, NothingIsSaidAtTheLimits) { EXPECT_FALSE(AtTheLimits().Verify().has_value()); }

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
    AtTheLimits sensor;
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
    AtTheLimits sensor;
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
  AtTheLimits sensor;
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

}  // namespace
}  // namespace volalign::verification_test
