#include "infer/checks/join.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::join_test {
namespace {

using namespace testing_infer;

Pose Placement(double x, double yaw_deg) {
  return MakePose({0, yaw_deg * M_PI / 180, 0}, {x, 0, 0});
}

/// Frames that are located in captures by hand.
struct Captures {
  std::vector<Capture> captures;
  std::vector<std::vector<Labelled>> labelled;
  std::vector<std::vector<LocateResult>> located;
  Stood stood;

  /// Returns the number of the capture.
  std::size_t AddCapture() {
    captures.push_back({"capture " + std::to_string(captures.size()), {}});
    labelled.emplace_back();
    located.emplace_back();
    return captures.size() - 1;
  }
  void Add(std::size_t capture, const std::string& sensor, const Pose& structure_from_sensor,
           const std::string& other_pose = "") {
    SensorFrame frame;
    frame.name = sensor;
    captures[capture].frames.push_back(frame);
    Labelled view;
    view.initial.agreement.same_label = view.initial.agreement.either = 100;
    view.other_pose = other_pose;
    labelled[capture].push_back(view);
    LocatedFrame of;
    of.own_pose = structure_from_sensor;
    located[capture].emplace_back(std::move(of));
  }
  std::vector<Pose> Join() {
    const CaptureSet input(captures, {});
    Seen seen;
    seen.input = &input;
    seen.labelled = PerFrame(labelled);
    stood = JoinCaptures(seen, PerFrame(located));
    return stood.first_from_stack;
  }
  SensorCode Code(std::size_t capture, std::size_t frame) const {
    const auto odd = stood.contradicted.find({capture, frame});
    return odd == stood.contradicted.end() ? SensorCode::kNone : odd->second.code;
  }
};

void ExpectNear(const Pose& a, const Pose& b) {
  const PoseError apart = ComparePoses(a, b);
  EXPECT_LT(apart.translation_m, 0.05);
  EXPECT_LT(apart.rotation_deg, 2);
}

TEST(JoinCaptures, AChainOfSensorsLeadsToEveryCapture) {
  // A and B see the stack first, then B and C, then C and D; E sees it with nobody.
  const std::map<std::string, Pose> sensors = {{"A", RingPose(0)},
                                               {"B", RingPose(60)},
                                               {"C", RingPose(120)},
                                               {"D", RingPose(180)},
                                               {"E", RingPose(240)}};
  const std::vector<Pose> places = {Placement(0, 0), Placement(0.5, 40), Placement(1, -70),
                                    Placement(-0.5, 10)};
  const std::vector<std::string> seen = {"AB", "BC", "CD", "E"};
  Captures captures;
  // The last two in the other order: it is not that of the chain.
  for (const std::size_t s : {0, 2, 1, 3}) {
    const std::size_t capture = captures.AddCapture();
    for (const char name : seen[s])
      captures.Add(capture, std::string(1, name),
                   places[s].inverse() * sensors.at(std::string(1, name)));
  }
  const std::vector<Pose> found = captures.Join();
  ASSERT_EQ(found.size(), 4u);
  ExpectNear(found[0], Pose::Identity());
  ExpectNear(found[1], places[2]);
  ExpectNear(found[2], places[1]);
  for (std::size_t s = 0; s < 3; ++s) {
    EXPECT_EQ(captures.Code(s, 0), SensorCode::kNone);
    EXPECT_EQ(captures.Code(s, 1), SensorCode::kNone);
  }
  EXPECT_EQ(captures.Code(3, 0), SensorCode::kUnconnected);
}

TEST(JoinCaptures, MostSensorsOfACaptureDecide) {
  // D takes the stack for one that stands turned by half a turn.
  const Pose place = Placement(0.4, 30);
  Captures captures;
  for (const Pose& at : {Placement(0, 0), place}) {
    const std::size_t capture = captures.AddCapture();
    for (int i = 0; i < 4; ++i) {
      Pose pose = at.inverse() * RingPose(90.0 * i);
      pose.translation() += Eigen::Vector3d(0.01 * i, -0.01, 0);  // own poses are off by that much
      if (capture == 1 && i == 3) pose = Placement(0, 180) * pose;
      captures.Add(capture, std::string(1, static_cast<char>('A' + i)), pose);
    }
  }
  ExpectNear(captures.Join()[1], place);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(captures.Code(0, i), SensorCode::kNone);
    EXPECT_EQ(captures.Code(1, i), i == 3 ? SensorCode::kDisagrees : SensorCode::kNone) << i;
  }
}

TEST(JoinCaptures, WhatIsOpenToDoubtGivesWay) {
  // Two sensors contradict each other about where the stack went. The first was not sure.
  for (const bool first_capture : {true, false}) {
    const Pose place = Placement(0.4, 30);
    Captures captures;
    for (const Pose& at : {Placement(0, 0), place}) {
      const std::size_t capture = captures.AddCapture();
      const bool doubtful = (capture == 0) == first_capture;
      Pose a = at.inverse() * RingPose(0);
      if (doubtful) a = Placement(0, 180) * a;
      captures.Add(capture, "A", a, doubtful ? "turned" : "");
      captures.Add(capture, "B", at.inverse() * RingPose(80));
    }
    ExpectNear(captures.Join()[1], place);
    EXPECT_EQ(captures.Code(first_capture ? 0 : 1, 0), SensorCode::kDisagrees);
    EXPECT_EQ(captures.Code(first_capture ? 1 : 0, 0), SensorCode::kNone);
    EXPECT_EQ(captures.Code(0, 1), SensorCode::kNone);
    EXPECT_EQ(captures.Code(1, 1), SensorCode::kNone);
  }
}

TEST(JoinCaptures, AFirstCaptureWithoutPosesIsTheReason) {
  Captures captures;
  captures.AddCapture();
  for (const std::size_t capture : {captures.AddCapture(), captures.AddCapture()}) {
    captures.Add(capture, "A", RingPose(0));
    captures.Add(capture, "B", RingPose(90));
  }
  captures.Join();
  for (const auto& [frame, finding] : captures.stood.contradicted) {
    EXPECT_EQ(finding.code, SensorCode::kUnconnected);
    EXPECT_TRUE(Has(finding.reason, "no sensor was placed in capture 0"));
    EXPECT_TRUE(Has(finding.hint, "name another capture first"));
  }
  EXPECT_EQ(captures.stood.contradicted.size(), 4u);
}

}  // namespace
}  // namespace volalign::join_test
