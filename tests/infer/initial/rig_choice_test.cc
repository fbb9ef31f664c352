// Which poses of a rig's sensors are chosen together, among candidates that are made by hand.

#include "infer/initial/rig_choice.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "core/base/odds.h"
#include "infer/initial/aliases.h"
#include "infer/initial/same_pose.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::rig_choice_test {
namespace {

using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// What speaks for a pose and for the same upside down: log odds.
struct Evidence {
  double floor, labels;
  double floor_over, labels_over;
};

/// Sensors round the structure, and nothing else, so that their clouds share nothing beside it.
struct Candidates {
  Structure structure = PaperStructure();
  std::vector<SensorView> views;
  std::vector<Pose> right, over;
  std::vector<std::vector<PoseCandidate>> poses;

  /// `roll_deg`: of each sensor; 90 of those past its end.
  explicit Candidates(const std::vector<Evidence>& evidence,
                      const std::vector<double>& roll_deg = {}) {
    const Pose motion = FindAliases(structure).front().motion;
    for (std::size_t i = 0; i < evidence.size(); ++i) {
      const double roll = i < roll_deg.size() ? roll_deg[i] : 90;
      right.push_back(RingPose(10 + 50 * static_cast<double>(i), 2, 0.4, roll));
      over.push_back(motion * right.back());
      views.push_back(MakeSensorView(
          testing_infer::Render(structure, testing_infer::Kinect(), right.back(), {false, 0}).depth,
          testing_infer::Kinect()));
      PoseCandidate a, b;
      a.structure_from_sensor = right.back();
      a.by_floor = evidence[i].floor;
      a.by_labels = evidence[i].labels;
      b.structure_from_sensor = over.back();
      b.by_floor = evidence[i].floor_over;
      b.by_labels = evidence[i].labels_over;
      poses.push_back({a, b});
    }
  }
  /// `turns`: of the right pose and of the other, where they are known. `twin`: of the last sensor.
  std::vector<PoseChoice> Choose(const std::vector<int>& turns = {}, int twin = 0) const {
    std::vector<SensorCandidates> sensors;
    for (std::size_t i = 0; i < views.size(); ++i)
      sensors.push_back({&views[i], poses[i], turns, i + 1 == views.size() ? twin : 0});
    return ChooseTogether(sensors, structure);
  }
  bool IsRight(const PoseChoice& choice, std::size_t i) const {
    return choice.found && SamePose(structure, choice.best.structure_from_sensor, right[i]);
  }
};

PoseCandidate Candidate(const Pose& pose, double floor, double names, double own_names = 0) {
  PoseCandidate candidate;
  candidate.structure_from_sensor = pose;
  candidate.by_floor = floor;
  candidate.by_labels = names;
  candidate.by_own_labels = own_names;
  return candidate;
}

Pose Upright(double yaw_deg, double height) {
  return Eigen::Translation3d(0, height, 0) *
         Pose(Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()));
}

/// Of a single sensor.
PoseChoice ChooseAmong(const std::vector<PoseCandidate>& poses) {
  const Candidates rig({{0, 0, 0, 0}});
  return ChooseTogether({{&rig.views[0], poses, {}, 0}}, rig.structure).front();
}

TEST(ChooseAlone, NothingAmongNothing) {
  const PoseChoice choice = ChooseAmong({});
  EXPECT_FALSE(choice.found);
  EXPECT_FALSE(choice.ambiguous);
}

TEST(ChooseAlone, TheFloorGoesBeforeTheLabels) {
  const PoseChoice choice =
      ChooseAmong({Candidate(Upright(0, 0), 12, -13), Candidate(Upright(90, 0.4), 0, 3)});
  ASSERT_TRUE(choice.found);
  EXPECT_EQ(choice.best.by_floor, 12);
  EXPECT_FALSE(choice.ambiguous);
}

TEST(ChooseAlone, LabelsTellOneStepOfASpiralFromTheNextWhereTheyAreClear) {
  for (const double names : {-1.5, -1.7}) {
    const PoseChoice choice =
        ChooseAmong({Candidate(Upright(90, 0.4), 1, names), Candidate(Upright(0, 0), 1, 3)});
    EXPECT_EQ(choice.best.by_labels, 3);
    EXPECT_EQ(choice.ambiguous, 3 - names < std::log(kDecisiveOdds)) << names;
  }
}

TEST(ChooseAlone, LabelsDoNotTellUpFromDown) {
  const Pose over = FindAliases(PaperStructure()).front().motion;
  const PoseChoice choice = ChooseAmong({Candidate(Upright(0, 0), 0, 3), Candidate(over, 0, -9)});
  EXPECT_EQ(choice.best.by_labels, 3);
  EXPECT_TRUE(choice.ambiguous);
  EXPECT_EQ(choice.rival.by_labels, -9);
  EXPECT_FALSE(ChooseAmong({Candidate(Upright(0, 0), 5, 3), Candidate(over, 0, -9)}).ambiguous)
      << "a floor does";
}

TEST(ChooseAlone, APersonsChoiceIsIgnoredWhereTheViewRefutesIt) {
  for (const double floor : {2.0, 8.0}) {
    const Candidates rig({{floor, 0, 0, 0}});
    const PoseChoice choice = rig.Choose({}, 2).front();
    EXPECT_EQ(rig.IsRight(choice, 0), floor > std::log(kDecisiveOdds));
    EXPECT_EQ(choice.given, floor < std::log(kDecisiveOdds));
  }
}

TEST(ChooseAlone, TheRivalIsTheBestOfSeveral) {
  const PoseChoice choice =
      ChooseAmong({Candidate(Upright(0, 0), 0, 3), Candidate(Upright(90, 0.4), 0, 0),
                   Candidate(Upright(180, 0.8), 0, 2), Candidate(Upright(-90, -0.4), 0, 1)});
  EXPECT_TRUE(choice.ambiguous);
  EXPECT_EQ(choice.rival.by_labels, 2);
  ASSERT_EQ(choice.twins.size(), 3u);
  EXPECT_NEAR(choice.twins[0].log_odds, 1, 1e-9);
  EXPECT_NEAR(choice.twins[2].log_odds, 3, 1e-9);
}

// Poses 10 cm and 5 deg apart are one pose that different labels led to; geometry has none.
TEST(ChooseAlone, TakesTheLabelsThatSuitThePoseBest) {
  PoseCandidate first = Candidate(Upright(0, 0), 0, 3, -9);
  PoseCandidate second = Candidate(Upright(5, 0.1), 0, 1, 2);
  PoseCandidate third = Candidate(Upright(2, 0), 0, 1, 4);
  second.trial = 1;
  second.alias = 2;
  third.source = PoseSource::kGeometry;
  const PoseChoice choice = ChooseAmong({first, second, third});
  EXPECT_FALSE(choice.ambiguous);
  EXPECT_EQ(choice.best.trial, 1u);
  EXPECT_EQ(choice.best.alias, 2);
  EXPECT_EQ(choice.best.by_own_labels, 2);
  EXPECT_EQ(choice.best.by_labels, 3);
}

TEST(ChooseTogether, LabelsOfMostDecideButSettleNothing) {
  const Evidence good{0, 3, 0, -9}, misled{0, -12, 0, 4};
  const Candidates rig({good, misled, good, good, misled});
  const std::vector<PoseChoice> choices = rig.Choose();
  for (std::size_t i = 0; i < choices.size(); ++i) {
    EXPECT_TRUE(rig.IsRight(choices[i], i)) << i;
    EXPECT_TRUE(choices[i].ambiguous) << i;
    EXPECT_TRUE(SamePose(rig.structure, choices[i].rival.structure_from_sensor, rig.over[i])) << i;
  }
  // Where most are misled, all are: still one answer.
  const Candidates wrong({misled, good, misled, misled});
  const std::vector<PoseChoice> all = wrong.Choose();
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_FALSE(wrong.IsRight(all[i], i)) << i;
    EXPECT_TRUE(all[i].ambiguous) << i;
  }
}

// Sensors that are mounted alike are upside down together or not at all: one other set of poses.
TEST(ChooseTogether, TheOtherSetIsListedAndCanBeChosen) {
  const Candidates rig(std::vector<Evidence>(4, {0, 3, 0, -9}));
  const std::vector<PoseChoice> choices = rig.Choose(), turned = rig.Choose({}, 2),
                                confirmed = rig.Choose({}, 1);
  for (std::size_t i = 0; i < choices.size(); ++i) {
    ASSERT_FALSE(choices[i].twins.empty()) << i;
    const PoseTwin& twin = choices[i].twins.front();
    EXPECT_EQ(twin.rig, choices[0].twins.front().rig) << "one choice of all";
    EXPECT_EQ(twin.number, 2);
    EXPECT_TRUE(SamePose(rig.structure, twin.structure_from_sensor, rig.over[i])) << i;
    EXPECT_NEAR(twin.log_odds, 0, 1e-9) << "labels do not count";
    // The sensor that was asked about takes the others with it, and nothing is open any more.
    EXPECT_TRUE(SamePose(rig.structure, turned[i].best.structure_from_sensor, rig.over[i])) << i;
    EXPECT_EQ(turned[i].given, i == 3) << i;
    EXPECT_FALSE(turned[i].ambiguous) << i;
    EXPECT_TRUE(rig.IsRight(confirmed[i], i)) << i;
    EXPECT_FALSE(confirmed[i].ambiguous) << i;
  }
  EXPECT_FALSE(rig.Choose({}, 7)[3].given) << "it has no such pose";
}

// What says nothing in one view does not say something in six, and what is clear in one does.
TEST(ChooseTogether, SmallDifferencesOfDepthsDoNotAddUp) {
  for (const double difference : {2.2, 2.4}) {
    Candidates rig(std::vector<Evidence>(6, {0, 3, 0, 3}));
    for (std::vector<PoseCandidate>& poses : rig.poses) {
      poses[0].by_depth = 1;
      poses[0].by_outline = difference - 1;
    }
    const std::vector<PoseChoice> choices = rig.Choose();
    for (std::size_t i = 0; i < choices.size(); ++i)
      EXPECT_EQ(choices[i].ambiguous, difference < std::log(kDecisiveOdds) / 2) << i;
  }
}

TEST(ChooseAlone, WhatIsImprobableIsNoTwin) {
  for (const double floor : {-13.0, -14.0}) {
    const PoseChoice choice =
        ChooseAmong({Candidate(Upright(0, 0), 0, 3), Candidate(Upright(90, 0.4), floor, 3)});
    EXPECT_EQ(choice.twins.size(), -floor > std::log(kNamedOdds) ? 0u : 1u) << floor;
  }
}

// Half of the pictures stand upright and half lie on their side: none of either contradicts the
// others that are mounted so.
TEST(ChooseTogether, RigsMayBeMountedInTwoWays) {
  const Evidence good{0, 3, 0, -9}, misled{0, -12, 0, 4};
  for (std::size_t wrong = 0; wrong < 6; ++wrong) {
    std::vector<Evidence> evidence(6, good);
    evidence[wrong] = misled;
    const Candidates rig(evidence, {0, 90, 0, 90, 0, 90});
    const std::vector<PoseChoice> choices = rig.Choose();
    for (std::size_t i = 0; i < choices.size(); ++i) {
      EXPECT_TRUE(rig.IsRight(choices[i], i)) << i << ", misled " << wrong;
      EXPECT_TRUE(choices[i].ambiguous) << i;
    }
  }
}

// Of two kinds of mounting with nothing that joins them, one is the network's: the others' up is
// unknown, unless there is a floor.
TEST(ChooseTogether, WhatNothingTellsIsNotGuessed) {
  const Evidence open{0, 3, 0, 2};
  const std::vector<double> roll = {0, 90, 0, 90, 0, 90};
  for (const bool floor : {false, true}) {
    std::vector<Evidence> evidence(6, open);
    if (floor) evidence[0] = evidence[1] = evidence[2] = evidence[3] = {12, 3, -14, 3};
    const Candidates rig(evidence, roll);
    std::vector<SensorCandidates> sensors;
    for (std::size_t i = 0; i < rig.views.size(); ++i) {
      sensors.push_back({&rig.views[i], rig.poses[i],
                         roll[i] > 0 ? std::vector<int>{0, 2} : std::vector<int>{3, 1}});
    }
    const std::vector<PoseChoice> choices = ChooseTogether(sensors, rig.structure);
    for (std::size_t i = 0; i < choices.size(); ++i) {
      EXPECT_TRUE(rig.IsRight(choices[i], i)) << i;
      EXPECT_EQ(choices[i].ambiguous, !floor) << i;
      EXPECT_EQ(choices[i].up_unknown, !floor && roll[i] == 0) << i;
    }
  }
}

TEST(ChooseTogether, TwoThatSeeTheFloorSettleTheOthersAndOneDoesNot) {
  const Evidence floor{12, 3, -14, 3}, misled{0, -12, 0, 4};
  for (const std::size_t count : {1u, 2u}) {
    std::vector<Evidence> evidence(count, floor);
    evidence.push_back(misled);
    const Candidates rig(evidence);
    const std::vector<PoseChoice> choices = rig.Choose();
    for (std::size_t i = 0; i < choices.size(); ++i) {
      EXPECT_EQ(choices[i].ambiguous, i == count && count == 1) << i << " of " << count;
      if (count == 2) {
        EXPECT_TRUE(rig.IsRight(choices[i], i)) << i;
      }
    }
  }
}

TEST(ChooseTogether, AFloorGoesBeforeHowTheOthersAreMounted) {
  const Evidence floor{12, 3, -14, 3};
  const Candidates rig({floor, floor, floor, floor}, {90, 90, 90, -90});
  const std::vector<PoseChoice> choices = rig.Choose();
  for (std::size_t i = 0; i < choices.size(); ++i) {
    EXPECT_TRUE(rig.IsRight(choices[i], i)) << i;
    EXPECT_FALSE(choices[i].ambiguous) << i;
  }
}

// Nothing tells up from down: sensors are then taken to be mounted as the network's were.
TEST(ChooseTogether, TheNetworksOrientationIsTakenWhereNothingElseTells) {
  const Evidence open{0, 3, 0, 3};
  const Candidates rig({open, open, open});
  for (const bool right : {true, false}) {
    const std::vector<PoseChoice> choices =
        rig.Choose(right ? std::vector<int>{0, 2} : std::vector<int>{2, 0});
    for (std::size_t i = 0; i < choices.size(); ++i) {
      EXPECT_EQ(rig.IsRight(choices[i], i), right) << i;
      EXPECT_TRUE(choices[i].ambiguous) << i;
    }
  }
}

TEST(ChooseTogether, ASensorWithoutPosesTakesNoPart) {
  const Evidence good{0, 3, 0, -9};
  Candidates rig({good, good, good});
  rig.poses[1].clear();
  const std::vector<PoseChoice> choices = rig.Choose();
  EXPECT_FALSE(choices[1].found);
  EXPECT_TRUE(rig.IsRight(choices[0], 0));
  EXPECT_TRUE(rig.IsRight(choices[2], 2));
}

// A wall on one side only, which two sensors see: where both are upright, in one place.
TEST(ChooseTogether, WhatTwoSensorsMeasuredLiesInTheSamePlaces) {
  const Evidence open{0, 1, 0, 1};
  Candidates rig({open, open});
  rig.poses[0].resize(1);  // known
  for (std::size_t i = 0; i < 2; ++i) {
    rig.right[i] = RingPose(80 + 20 * static_cast<double>(i), 2, 0.4);
    rig.over[i] = FindAliases(rig.structure).front().motion * rig.right[i];
    rig.poses[i][0].structure_from_sensor = rig.right[i];
    if (i > 0) rig.poses[i][1].structure_from_sensor = rig.over[i];
    rig.views[i] = MakeSensorView(
        testing_infer::Render(rig.structure, testing_infer::Kinect(), rig.right[i], {true, 3.5})
            .depth,
        testing_infer::Kinect());
  }
  const std::vector<PoseChoice> choices = rig.Choose();
  EXPECT_TRUE(rig.IsRight(choices[1], 1));
  EXPECT_FALSE(choices[1].ambiguous);
}

}  // namespace
}  // namespace volalign::rig_choice_test
