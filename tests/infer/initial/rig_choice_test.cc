#include "infer/initial/rig_choice.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/odds.h"
#include "infer/initial/floor.h"
#include "infer/initial/symmetries.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

// Which poses of a rig's sensors are chosen together, among candidates that are made by hand.
namespace volalign::rig_choice_test {
namespace {

using namespace testing_infer;

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
  std::vector<std::vector<Hypothesis>> poses;

  /// `roll_deg`: of each sensor; 90 of those past its end.
  explicit Candidates(const std::vector<Evidence>& evidence,
                      const std::vector<double>& roll_deg = {}) {
    const Pose motion = FindSymmetries(structure).front().motion;
    for (std::size_t i = 0; i < evidence.size(); ++i) {
      const double roll = i < roll_deg.size() ? roll_deg[i] : 90;
      right.push_back(RingPose(10 + 50 * static_cast<double>(i), 2, 0.4, roll));
      over.push_back(motion * right.back());
      views.push_back(
          MakeSensorView(Render(structure, Kinect(), right.back(), {false, 0}).depth, Kinect()));
      Hypothesis a, b;
      a.structure_from_sensor = right.back();
      a.by_floor = evidence[i].floor;
      a.by_labels = evidence[i].labels;
      b.structure_from_sensor = over.back();
      b.by_floor = evidence[i].floor_over;
      b.by_labels = evidence[i].labels_over;
      poses.push_back({a, b});
    }
  }
  /// `turns`: of the right pose and of the other, where they are known. `alternative`: of the last
  /// sensor.
  std::vector<PoseChoice> Choose(const std::vector<int>& turns = {}, int alternative = 0) const {
    std::vector<SensorHypotheses> sensors;
    for (std::size_t i = 0; i < views.size(); ++i) {
      sensors.push_back({&views[i], poses[i], i + 1 == views.size() ? alternative : 0});
      for (std::size_t k = 0; k < turns.size(); ++k) sensors[i].poses[k].turns = turns[k];
    }
    return ChooseTogether(sensors, structure);
  }
  bool IsRight(const PoseChoice& choice, std::size_t i) const {
    return choice.found && SamePose(structure, choice.best.structure_from_sensor, right[i]);
  }
  void ExpectEach(const std::vector<PoseChoice>& choices, bool is_right, bool ambiguous) const {
    for (std::size_t i = 0; i < choices.size(); ++i) {
      EXPECT_EQ(IsRight(choices[i], i), is_right) << i;
      EXPECT_EQ(choices[i].ambiguous(), ambiguous) << i;
    }
  }
};

const Evidence kGood{0, 3, 0, -9}, kMisled{0, -12, 0, 4}, kFloor{12, 3, -14, 3};

Hypothesis Candidate(const Pose& pose, double floor, double names) {
  Hypothesis candidate;
  candidate.structure_from_sensor = pose;
  candidate.by_floor = floor;
  candidate.by_labels = names;
  return candidate;
}

Pose Upright(double yaw_deg, double height) {
  return MakePose({0, yaw_deg * M_PI / 180, 0}, {0, height, 0});
}

/// Of a single sensor.
PoseChoice ChooseAmong(const std::vector<Hypothesis>& poses) {
  const Candidates rig({{0, 0, 0, 0}});
  return ChooseTogether({{&rig.views[0], poses, 0}}, rig.structure).front();
}

TEST(ChooseAlone, NothingAmongNothing) {
  const PoseChoice choice = ChooseAmong({});
  EXPECT_FALSE(choice.found);
  EXPECT_FALSE(choice.ambiguous());
}

TEST(ChooseAlone, TheFloorGoesBeforeTheLabels) {
  const PoseChoice choice =
      ChooseAmong({Candidate(Upright(0, 0), 12, -13), Candidate(Upright(90, 0.4), 0, 3)});
  ASSERT_TRUE(choice.found);
  EXPECT_EQ(choice.best.by_floor, 12);
  EXPECT_FALSE(choice.ambiguous());
}

TEST(ChooseAlone, LabelsTellOneStepOfASpiralFromTheNextWhereTheyAreClear) {
  for (const double names : {-1.5, -1.7}) {
    const PoseChoice choice =
        ChooseAmong({Candidate(Upright(90, 0.4), 1, names), Candidate(Upright(0, 0), 1, 3)});
    EXPECT_EQ(choice.best.by_labels, 3);
    EXPECT_EQ(choice.ambiguous(), 3 - names < std::log(kDecisiveOdds)) << names;
  }
}

TEST(ChooseAlone, LabelsDoNotTellUpFromDown) {
  const Pose over = FindSymmetries(PaperStructure()).front().motion;
  const PoseChoice choice = ChooseAmong({Candidate(Upright(0, 0), 0, 3), Candidate(over, 0, -9)});
  EXPECT_EQ(choice.best.by_labels, 3);
  EXPECT_TRUE(choice.ambiguous());
  EXPECT_TRUE(SamePose(PaperStructure(), choice.alternatives[0].structure_from_sensor, over));
  EXPECT_FALSE(ChooseAmong({Candidate(Upright(0, 0), 5, 3), Candidate(over, 0, -9)}).ambiguous())
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
  EXPECT_TRUE(choice.ambiguous());
  ASSERT_EQ(choice.alternatives.size(), 3u);
  EXPECT_NEAR(choice.alternatives[0].structure_from_sensor.translation().y(), 0.8, 1e-9);
  EXPECT_NEAR(choice.alternatives[0].log_odds, 1, 1e-9);
  EXPECT_NEAR(choice.alternatives[2].log_odds, 3, 1e-9);
}

// Poses 10 cm and 5 deg apart are one pose that different labels led to; geometry has none.
TEST(ChooseAlone, KeepsALabellingsOwnPoseWithTheEvidenceOfAll) {
  Hypothesis first = Candidate(Upright(0, 0), 0, 3);
  Hypothesis second = Candidate(Upright(5, 0.1), 0, 1);
  Hypothesis third = Candidate(Upright(2, 0), 0, 1);
  first.symmetry = 2;
  second.labelling = 1;
  third.source = PoseSource::kGeometry;
  const PoseChoice choice = ChooseAmong({first, second, third});
  EXPECT_FALSE(choice.ambiguous());
  EXPECT_EQ(choice.best.labelling, 1u);
  EXPECT_EQ(choice.best.symmetry, -1);
  EXPECT_EQ(choice.best.by_labels, 3);
}

TEST(ChooseTogether, LabelsOfMostDecideButSettleNothing) {
  const Candidates rig({kGood, kMisled, kGood, kGood, kMisled});
  const std::vector<PoseChoice> choices = rig.Choose();
  rig.ExpectEach(choices, true, true);
  for (std::size_t i = 0; i < choices.size(); ++i)
    EXPECT_TRUE(
        SamePose(rig.structure, choices[i].alternatives[0].structure_from_sensor, rig.over[i]))
        << i;
  // Where most are misled, all are: still one answer.
  const Candidates wrong({kMisled, kGood, kMisled, kMisled});
  wrong.ExpectEach(wrong.Choose(), false, true);
}

// Sensors that are mounted alike are upside down together or not at all: one other set of poses.
TEST(ChooseTogether, TheOtherSetIsListedAndCanBeChosen) {
  const Candidates rig(std::vector<Evidence>(4, kGood));
  const std::vector<PoseChoice> choices = rig.Choose(), turned = rig.Choose({}, 2),
                                confirmed = rig.Choose({}, 1);
  for (std::size_t i = 0; i < choices.size(); ++i) {
    ASSERT_FALSE(choices[i].alternatives.empty()) << i;
    const PoseAlternative& alternative = choices[i].alternatives.front();
    EXPECT_EQ(alternative.rig, choices[0].alternatives.front().rig) << "one choice of all";
    EXPECT_EQ(alternative.number, 2);
    EXPECT_TRUE(SamePose(rig.structure, alternative.structure_from_sensor, rig.over[i])) << i;
    EXPECT_NEAR(alternative.log_odds, 0, 1e-9) << "labels do not count";
    // The sensor that was asked about takes the others with it, and nothing is open any more.
    EXPECT_TRUE(SamePose(rig.structure, turned[i].best.structure_from_sensor, rig.over[i])) << i;
    EXPECT_EQ(turned[i].given, i == 3) << i;
    EXPECT_FALSE(turned[i].ambiguous()) << i;
    EXPECT_TRUE(rig.IsRight(confirmed[i], i)) << i;
    EXPECT_FALSE(confirmed[i].ambiguous()) << i;
  }
  EXPECT_FALSE(rig.Choose({}, 7)[3].given) << "it has no such pose";
}

// What says nothing in one view does not say something in six, and what is clear in one does.
TEST(ChooseTogether, SmallDifferencesOfDepthsDoNotAddUp) {
  for (const double difference : {2.2, 2.4}) {
    Candidates rig(std::vector<Evidence>(6, {0, 3, 0, 3}));
    for (std::vector<Hypothesis>& poses : rig.poses) {
      poses[0].by_depth = 1;
      poses[0].by_outline = difference - 1;
    }
    const std::vector<PoseChoice> choices = rig.Choose();
    for (std::size_t i = 0; i < choices.size(); ++i)
      EXPECT_EQ(choices[i].ambiguous(), difference < std::log(kDecisiveOdds) / 2) << i;
  }
}

TEST(ChooseAlone, WhatIsImprobableIsNoAlternative) {
  for (const double floor : {-13.0, -14.0}) {
    const PoseChoice choice =
        ChooseAmong({Candidate(Upright(0, 0), 0, 3), Candidate(Upright(90, 0.4), floor, 3)});
    EXPECT_EQ(choice.alternatives.size(), -floor > std::log(kNamedOdds) ? 0u : 1u) << floor;
  }
}

// Half of the pictures stand upright and half lie on their side: none of either contradicts the
// others that are mounted so.
TEST(ChooseTogether, RigsMayBeMountedInTwoWays) {
  for (std::size_t wrong = 0; wrong < 6; ++wrong) {
    SCOPED_TRACE(wrong);
    std::vector<Evidence> evidence(6, kGood);
    evidence[wrong] = kMisled;
    const Candidates rig(evidence, {0, 90, 0, 90, 0, 90});
    rig.ExpectEach(rig.Choose(), true, true);
  }
}

// Of two kinds of mounting with nothing that joins them, one is the network's: it is taken, but
// nothing is settled unless there is a floor.
TEST(ChooseTogether, WhatNothingTellsIsNotGuessed) {
  const Evidence open{0, 3, 0, 2};
  const std::vector<double> roll = {0, 90, 0, 90, 0, 90};
  for (const bool floor : {false, true}) {
    std::vector<Evidence> evidence(6, open);
    if (floor) evidence[0] = evidence[1] = evidence[2] = evidence[3] = kFloor;
    const Candidates rig(evidence, roll);
    std::vector<SensorHypotheses> sensors;
    for (std::size_t i = 0; i < rig.views.size(); ++i) {
      sensors.push_back({&rig.views[i], rig.poses[i]});
      sensors[i].poses[0].turns = roll[i] > 0 ? 0 : 3;
      sensors[i].poses[1].turns = roll[i] > 0 ? 2 : 1;
    }
    const std::vector<PoseChoice> choices = ChooseTogether(sensors, rig.structure);
    rig.ExpectEach(choices, true, !floor);
  }
}

TEST(ChooseTogether, TwoThatSeeTheFloorSettleTheOthersAndOneDoesNot) {
  for (const std::size_t count : {1u, 2u}) {
    std::vector<Evidence> evidence(count, kFloor);
    evidence.push_back(kMisled);
    const Candidates rig(evidence);
    const std::vector<PoseChoice> choices = rig.Choose();
    for (std::size_t i = 0; i < choices.size(); ++i) {
      EXPECT_EQ(choices[i].ambiguous(), i == count && count == 1) << i << " of " << count;
      if (count == 2) {
        EXPECT_TRUE(rig.IsRight(choices[i], i)) << i;
      }
    }
  }
}

TEST(ChooseTogether, AFloorGoesBeforeHowTheOthersAreMounted) {
  const Candidates rig({kFloor, kFloor, kFloor, kFloor}, {90, 90, 90, -90});
  rig.ExpectEach(rig.Choose(), true, false);
}

// Nothing tells up from down: sensors are then taken to be mounted as the network's were.
TEST(ChooseTogether, TheNetworksOrientationIsTakenWhereNothingElseTells) {
  const Evidence open{0, 3, 0, 3};
  const Candidates rig({open, open, open});
  rig.ExpectEach(rig.Choose({0, 2}), true, true);
  rig.ExpectEach(rig.Choose({2, 0}), false, true);
}

TEST(ChooseTogether, ASensorWithoutPosesTakesNoPart) {
  Candidates rig({kGood, kGood, kGood});
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
    rig.over[i] = FindSymmetries(rig.structure).front().motion * rig.right[i];
    rig.poses[i][0].structure_from_sensor = rig.right[i];
    if (i > 0) rig.poses[i][1].structure_from_sensor = rig.over[i];
    rig.views[i] =
        MakeSensorView(Render(rig.structure, Kinect(), rig.right[i], {true, 3.5}).depth, Kinect());
  }
  const std::vector<PoseChoice> choices = rig.Choose();
  EXPECT_TRUE(rig.IsRight(choices[1], 1));
  EXPECT_FALSE(choices[1].ambiguous());
}

Structure Cube() {
  return Structure::FromBoxes("cube", {Box::FromMinMax("c", {0, 0, 0}, {0.4, 0.4, 0.4})});
}

/// Seven by seven pixels, 12.5 mm apart at 1 m, of a sensor 1.2 m above the floor, over `x`, that
/// looks straight down beside (or on) the cube: everything at one depth.
SensorView FromAbove(float depth) {
  SensorView view;
  view.depth = DepthImage(7, 7, depth);
  view.rays = {7, 7, {}};
  view.ray_areas = Image<float>(7, 7, 0.0125f * 0.0125f);
  for (const auto [u, v] : Pixels(7, 7))
    view.rays.rays.emplace_back(0.0125f * (u - 3), 0.0125f * (v - 3));
  return view;
}

Pose Above(double x) {
  Pose pose = Pose::Identity();
  pose.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;  // z down, y towards +z
  pose.translation() = Eigen::Vector3d(x, 1.2, 0.2);
  return pose;
}

TEST(FindFloor, CountsPixels) {
  struct Case {
    float depth;
    double x;
    int on_floor, below;
  };
  // The tolerance at 1.2 m is 3 cm + 2 % of 1.2 m = 5.4 cm; clearly below is over three of them.
  const Case cases[] = {{1.2f, -0.5, 49, 0}, {1.24f, -0.5, 49, 0}, {1.16f, -0.5, 49, 0},
                        {1.3f, -0.5, 0, 0},  {0.6f, -0.5, 0, 0},   {1.38f, -0.5, 0, 49},
                        {1.35f, -0.5, 0, 0}, {1.2f, -0.1, 49, 0},  {1.2f, 0.02, 0, 0},
                        {0.8f, 0.2, 0, 0}};
  for (const Case& c : cases) {
    const FloorFit floor = FindFloor(FromAbove(c.depth), Cube(), Above(c.x));
    EXPECT_EQ(floor.pixels, 49);
    EXPECT_EQ(floor.on_floor, c.on_floor) << c.depth << " m at " << c.x;
    EXPECT_EQ(floor.below, c.below) << c.depth << " m at " << c.x;
    EXPECT_EQ(floor.balance(), c.on_floor - 2 * c.below);
    EXPECT_EQ(floor.LogOdds() > 0, c.on_floor > 0) << c.on_floor;
  }
}

// 1.3 m under a cube that stands at a height of 0.9 m, seen from 2.5 m.
TEST(FindFloor, UnderATable) {
  Pose above = Above(-0.5);
  EXPECT_EQ(FindFloor(FromAbove(2.5f), Cube(), above).below, 0);
  // A box is less high than a table.
  EXPECT_EQ(FindFloor(FromAbove(1.45f), Cube(), above).below, 49);
  // What is upside down shows the floor's other side: a ceiling is no floor of a table.
  above.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal() * above.linear();
  above.translation().y() = -2;
  EXPECT_EQ(FindFloor(FromAbove(0.5f), Cube(), above).below, 49);
}

/// A cube on a table or in mid-air, before walls that reach down; no floor is seen.
FloorFit CubeAboveTheGround(const std::vector<Box>& with) {
  std::vector<Box> boxes = Cube().boxes();
  boxes.insert(boxes.end(), with.begin(), with.end());
  const Pose pose = LookAt({0.2, 1.0, 1.8}, {0.2, 0.1, 0.2}, 0);
  const Structure seen = Structure::FromBoxes("seen", boxes);
  const Pose origin = Pose(Eigen::Translation3d(0, 0, 0));
  const DepthImage depth = Render(seen, Kinect(), pose, {false, 2.5, origin}).depth;
  return FindFloor(MakeSensorView(depth, Kinect()), Cube(), pose);
}

TEST(FindFloor, BesideATablesEdgeIsSeenFarther) {
  const FloorFit floats = CubeAboveTheGround({});
  EXPECT_EQ(floats.beside, 0);
  EXPECT_GT(floats.passing, 0);
  EXPECT_TRUE(floats.Floats());
  EXPECT_LT(floats.balance(), 0);
  const FloorFit stands =
      CubeAboveTheGround({Box::FromMinMax("table", {-0.3, -0.05, -0.2}, {0.7, 0, 0.7})});
  EXPECT_GT(stands.below, stands.on_floor / 2) << "what lies beyond the table";
  EXPECT_GT(stands.beside, 0);
  EXPECT_FALSE(stands.Floats());
  EXPECT_GT(stands.balance(), 0);
  EXPECT_GT(stands.LogOdds(), floats.LogOdds() + std::log(100.0));
  // At an edge of the table, too.
  const FloorFit edge =
      CubeAboveTheGround({Box::FromMinMax("table", {-0.3, -0.05, -0.2}, {0.45, 0, 0.42})});
  EXPECT_GT(edge.passing, 0);
  EXPECT_FALSE(edge.Floats());
}

// An upright side that reaches down to the floor is none, and what stands alone may be anything.
TEST(FindFloor, IsLevel) {
  Pose level = Pose::Identity();  // 3 cm above the floor, looking along it
  level.linear() << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  level.translation() = Eigen::Vector3d(-1.5, 0.03, 0.2);
  EXPECT_EQ(FindFloor(FromAbove(1), Cube(), level).on_floor, 0);
  SensorView speck = FromAbove(0);
  speck.depth(3, 3) = 1.2f;
  EXPECT_EQ(FindFloor(speck, Cube(), Above(-0.5)).on_floor, 0);
}

// At a pose half a metre beside the true one the top of the cube, 0.4 m up, would be floor if the
// cube were that much higher; at the true pose it is the cube.
TEST(FindFloor, IsNotTheStructureAtAPoseThatCompetes) {
  const Pose true_pose = Above(0.2);
  Pose shifted = true_pose;
  shifted.translation() += Eigen::Vector3d(-0.8, -0.4, 0);
  const SensorView view = FromAbove(0.8f);
  EXPECT_EQ(FindFloor(view, Cube(), shifted).on_floor, 49);
  EXPECT_EQ(FindFloors(view, Cube(), {shifted, true_pose}).front().on_floor, 0);
}

TEST(FindFloor, NothingMeasuredSaysNothing) {
  const FloorFit floor = FindFloor(FromAbove(0), Cube(), Above(-0.5));
  EXPECT_EQ(floor.pixels, 0);
  EXPECT_EQ(floor.LogOdds(), 0);
}

TEST(FloorMargin, IsTheLeastDifferenceToASymmetry) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const SensorView view = MakeSensorView(Render(structure, Kinect(), pose).depth, Kinect());
  EXPECT_EQ(FloorMargin(view, structure, {}, pose), std::numeric_limits<double>::infinity());
  // Two motions by hand: upside down about the stack's middle, which is at the origin's height, and
  // 0.4 m higher.
  StructureSymmetry over, higher;
  over.motion.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  higher.motion.translation().y() = 0.4;
  const double own = FindFloor(view, structure, pose).LogOdds();
  const double upside_down = FindFloor(view, structure, over.motion * pose).LogOdds();
  const double raised = FindFloor(view, structure, higher.motion * pose).LogOdds();
  EXPECT_LT(upside_down, own);
  EXPECT_LT(raised, own);
  EXPECT_DOUBLE_EQ(FloorMargin(view, structure, {over}, pose), own - upside_down);
  EXPECT_DOUBLE_EQ(FloorMargin(view, structure, {over, higher}, pose),
                   own - std::max(upside_down, raised));
  // At the raised pose the true one is a symmetry that the floor speaks for.
  StructureSymmetry lower;
  lower.motion.translation().y() = -0.4;
  EXPECT_LT(FloorMargin(view, structure, {lower}, higher.motion * pose), -std::log(100.0));
}

}  // namespace
}  // namespace volalign::rig_choice_test
