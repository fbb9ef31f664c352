#include "infer/checks/join.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/metrics.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::join_test {
namespace {

using testing_infer::RingPose;

Pose Placement(double x, double yaw_deg) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(Eigen::Vector3d(0, yaw_deg * M_PI / 180, 0));
  pose.translation().x() = x;
  return pose;
}

/// Frames that are located in stills by hand.
struct Stills {
  std::vector<Still> stills;
  std::vector<std::vector<Labelled>> labelled;
  std::vector<std::vector<LocateResult>> located;
  Stood stood;

  /// Returns the number of the still.
  std::size_t AddStill() {
    stills.push_back({"still " + std::to_string(stills.size()), {}});
    labelled.emplace_back();
    located.emplace_back();
    return stills.size() - 1;
  }
  void Add(std::size_t still, const std::string& sensor, const Pose& structure_from_sensor,
           const std::string& other_pose = "") {
    SensorFrame frame;
    frame.name = sensor;
    stills[still].frames.push_back(frame);
    Labelled view;
    view.initial.agreement.same_label = view.initial.agreement.either = 100;
    view.other_pose = other_pose;
    labelled[still].push_back(view);
    LocatedFrame of;
    of.own_pose = structure_from_sensor;
    located[still].emplace_back(std::move(of));
  }
  std::vector<Pose> Join() {
    const CaptureSet capture(stills, {});
    Seen seen;
    seen.capture = &capture;
    seen.labelled = PerFrame(labelled);
    stood = JoinStills(seen, PerFrame(located));
    return stood.first_from_stack;
  }
  SensorCode Code(std::size_t still, std::size_t frame) const {
    const auto odd = stood.contradicted.find({still, frame});
    return odd == stood.contradicted.end() ? SensorCode::kNone : odd->second.code;
  }
};

void ExpectNear(const Pose& a, const Pose& b) {
  const PoseError apart = ComparePoses(a, b);
  EXPECT_LT(apart.translation_m, 0.05);
  EXPECT_LT(apart.rotation_deg, 2);
}

TEST(JoinStills, AChainOfSensorsLeadsToEveryStill) {
  // A and B see the stack first, then B and C, then C and D; E sees it with nobody.
  const std::map<std::string, Pose> sensors = {{"A", RingPose(0)},
                                               {"B", RingPose(60)},
                                               {"C", RingPose(120)},
                                               {"D", RingPose(180)},
                                               {"E", RingPose(240)}};
  const std::vector<Pose> places = {Placement(0, 0), Placement(0.5, 40), Placement(1, -70),
                                    Placement(-0.5, 10)};
  const std::vector<std::string> seen = {"AB", "BC", "CD", "E"};
  Stills stills;
  // The last two in the other order: it is not that of the chain.
  for (const std::size_t s : {0, 2, 1, 3}) {
    const std::size_t still = stills.AddStill();
    for (const char name : seen[s])
      stills.Add(still, std::string(1, name),
                 places[s].inverse() * sensors.at(std::string(1, name)));
  }
  const std::vector<Pose> found = stills.Join();
  ASSERT_EQ(found.size(), 4u);
  ExpectNear(found[0], Pose::Identity());
  ExpectNear(found[1], places[2]);
  ExpectNear(found[2], places[1]);
  for (std::size_t s = 0; s < 3; ++s) {
    EXPECT_EQ(stills.Code(s, 0), SensorCode::kNone);
    EXPECT_EQ(stills.Code(s, 1), SensorCode::kNone);
  }
  EXPECT_EQ(stills.Code(3, 0), SensorCode::kUnconnected);
}

TEST(JoinStills, MostSensorsOfAStillDecide) {
  // D takes the stack for one that stands turned by half a turn.
  const Pose place = Placement(0.4, 30);
  Stills stills;
  for (const Pose& at : {Placement(0, 0), place}) {
    const std::size_t still = stills.AddStill();
    for (int i = 0; i < 4; ++i) {
      Pose pose = at.inverse() * RingPose(90.0 * i);
      pose.translation() += Eigen::Vector3d(0.01 * i, -0.01, 0);  // own poses are off by that much
      if (still == 1 && i == 3) pose = Placement(0, 180) * pose;
      stills.Add(still, std::string(1, static_cast<char>('A' + i)), pose);
    }
  }
  ExpectNear(stills.Join()[1], place);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(stills.Code(0, i), SensorCode::kNone);
    EXPECT_EQ(stills.Code(1, i), i == 3 ? SensorCode::kDisagrees : SensorCode::kNone) << i;
  }
}

TEST(JoinStills, WhatIsOpenToDoubtGivesWay) {
  // Two sensors contradict each other about where the stack went. The first was not sure.
  for (const bool first_still : {true, false}) {
    const Pose place = Placement(0.4, 30);
    Stills stills;
    for (const Pose& at : {Placement(0, 0), place}) {
      const std::size_t still = stills.AddStill();
      const bool doubtful = (still == 0) == first_still;
      Pose a = at.inverse() * RingPose(0);
      if (doubtful) a = Placement(0, 180) * a;
      stills.Add(still, "A", a, doubtful ? "turned" : "");
      stills.Add(still, "B", at.inverse() * RingPose(80));
    }
    ExpectNear(stills.Join()[1], place);
    EXPECT_EQ(stills.Code(first_still ? 0 : 1, 0), SensorCode::kDisagrees);
    EXPECT_EQ(stills.Code(first_still ? 1 : 0, 0), SensorCode::kNone);
    EXPECT_EQ(stills.Code(0, 1), SensorCode::kNone);
    EXPECT_EQ(stills.Code(1, 1), SensorCode::kNone);
  }
}

TEST(JoinStills, AFirstStillWithoutPosesIsTheReason) {
  Stills stills;
  stills.AddStill();
  for (const std::size_t still : {stills.AddStill(), stills.AddStill()}) {
    stills.Add(still, "A", RingPose(0));
    stills.Add(still, "B", RingPose(90));
  }
  stills.Join();
  for (const auto& [frame, finding] : stills.stood.contradicted) {
    EXPECT_EQ(finding.code, SensorCode::kUnconnected);
    EXPECT_NE(finding.reason.find("no sensor was placed in still 0"), std::string::npos);
    EXPECT_NE(finding.hint.find("name another capture first"), std::string::npos);
  }
  EXPECT_EQ(stills.stood.contradicted.size(), 4u);
}

}  // namespace
}  // namespace volalign::join_test
