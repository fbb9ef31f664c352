#include "infer/checks/arrangements.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "infer/checks/free_space.h"
#include "infer/checks/join.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::arrangements_test {
namespace {

using namespace testing_infer;

TEST(Arrangements, ATurnOrExchangeThatChangesNothingIsInNoList) {
  const Structure structure = PaperStructure();
  const std::vector<Arrangement> list = Arrangements(structure);
  ASSERT_FALSE(list.empty());
  EXPECT_TRUE(list.front().code == SensorCode::kNone);
  std::set<std::string> sentences;
  for (const Arrangement& arrangement : list) {
    sentences.insert(arrangement.sentence);
    EXPECT_NEAR(arrangement.structure.FloorHeight(), structure.FloorHeight(), 1e-9)
        << arrangement.sentence;
  }
  // Exchanging the two boxes that overhang along z is the mirror image.
  EXPECT_EQ(sentences.count("boxes mid_bottom and top are swapped"), 0u);
  EXPECT_EQ(sentences.count("the stack or the frames are mirrored"), 1u);

  // Cubes in one column: a quarter turn, an exchange or a mirror image is the same column.
  std::vector<Box> cubes;
  cubes.reserve(3);
  for (int i = 0; i < 3; ++i) {
    cubes.push_back(Box::FromMinMax("c" + std::to_string(i), Eigen::Vector3d(0, 0.4 * i, 0),
                                    Eigen::Vector3d(0.4, 0.4 * i + 0.4, 0.4)));
  }
  for (const Arrangement& arrangement : Arrangements(Structure::FromBoxes("column", cubes)))
    EXPECT_TRUE(arrangement.code == SensorCode::kNone ||
                arrangement.code == SensorCode::kAssemblyMissing)
        << arrangement.sentence;
}

/// Corners of all boxes, from their middle.
std::vector<Eigen::Vector3d> Corners(const Structure& structure) {
  std::vector<Eigen::Vector3d> corners;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Box& box : structure.boxes()) {
    for (const Eigen::Vector3d& corner : box.Corners()) {
      corners.push_back(corner);
      sum += corner;
    }
  }
  for (Eigen::Vector3d& corner : corners) corner -= sum / static_cast<double>(corners.size());
  return corners;
}

TEST(Arrangements, AMirroredStackIsTheReflectionOfEveryCorner) {
  std::vector<Box> boxes = {
      Box::FromMinMax("low", Eigen::Vector3d(-0.3, 0, -0.2), Eigen::Vector3d(0.3, 0.4, 0.2)),
      Box::FromMinMax("high", Eigen::Vector3d(-0.4, 0.4, -0.1), Eigen::Vector3d(0.1, 0.8, 0.25))};
  boxes[1].structure_from_box.linear() =
      Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Structure structure = Structure::FromBoxes("askew", boxes);
  const std::vector<Arrangement> list = Arrangements(structure);
  const auto mirrored = std::find_if(list.begin(), list.end(), [](const Arrangement& arrangement) {
    return arrangement.code == SensorCode::kAssemblyMirrored;
  });
  ASSERT_NE(mirrored, list.end());
  const std::vector<Eigen::Vector3d> corners = Corners(mirrored->structure);
  for (const Eigen::Vector3d& corner : Corners(structure)) {
    const Eigen::Vector3d reflected(corner.x(), corner.y(), -corner.z());
    EXPECT_TRUE(std::any_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& other) {
      return (other - reflected).norm() < 1e-9;
    })) << reflected.transpose();
  }
}

TEST(Displaced, IsABoxWithWhatStandsOnItElsewhereAboveTheFloor) {
  const Structure structure = PaperStructure();
  const std::vector<Box>& boxes = structure.boxes();
  const auto height = [](const Structure& of, std::size_t box) {
    return of.boxes()[box].structure_from_box.translation().y();
  };
  const Arrangement upper = Displaced(structure, {2, 3}, {0, -0.2, 0});
  EXPECT_EQ(upper.code, SensorCode::kAssemblyHeight);
  EXPECT_EQ(upper.sentence,
            "box " + boxes[2].name + ", with what stands on it, stands 20 cm lower than described");
  ASSERT_EQ(upper.structure.boxes().size(), boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i)
    EXPECT_NEAR(height(upper.structure, i), height(structure, i) - (i < 2 ? 0 : 0.2), 1e-12);
  // On another box, which the floor is under.
  const Arrangement all = Displaced(structure, {0, 1, 2, 3}, {0, 0.3, 0});
  EXPECT_EQ(all.sentence, "box " + boxes[0].name + " stands higher than described");
  ASSERT_EQ(all.structure.boxes().size(), boxes.size() + 1);
  EXPECT_NEAR(all.structure.FloorHeight(), structure.FloorHeight(), 1e-12);
  EXPECT_NEAR(height(all.structure, 3), height(structure, 3) + 0.3, 1e-12);
}

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
  EXPECT_TRUE(Within(ComparePoses(found[0], Pose::Identity()), 0.05, 2));
  EXPECT_TRUE(Within(ComparePoses(found[1], places[2]), 0.05, 2));
  EXPECT_TRUE(Within(ComparePoses(found[2], places[1]), 0.05, 2));
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
  EXPECT_TRUE(Within(ComparePoses(captures.Join()[1], place), 0.05, 2));
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
    EXPECT_TRUE(Within(ComparePoses(captures.Join()[1], place), 0.05, 2));
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

constexpr double kRefuting = 100;
/// What two sensors alone see of each other's surroundings is little.
constexpr double kDoubtful = 1;

/// Sensors round a row of cartons, in a room whose cupboard and bench are no part of the structure.
struct Room {
  Rig rig;
  std::vector<SensorView> views;
  std::vector<Pose> poses;

  explicit Room(int sensors) : rig(RowInARoom(80, sensors)) {
    for (const SensorFrame& frame : rig.frames) {
      views.push_back(MakeSensorView(frame.depth, frame.intrinsics));
      poses.push_back(*frame.ground_truth);
    }
  }
  void TurnAboutTheVertical(std::size_t i) {
    poses[i] = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()) * poses[i];
  }
  std::vector<std::optional<FreeSpaceViolation>> Find(double refuting_odds = kRefuting) const {
    std::vector<const SensorView*> all;
    for (const SensorView& view : views) all.push_back(&view);
    return FindFreeSpaceViolations(all, poses, rig.structure, refuting_odds, 1);
  }
};

TEST(FindFreeSpaceViolations, NothingOfSensorsThatStandWhereTheyDo) {
  for (const int sensors : {1, 2, 5}) {
    for (const auto& found : Room(sensors).Find()) EXPECT_FALSE(found.has_value()) << sensors;
  }
}

TEST(FindFreeSpaceViolations, OfTwoEitherMayBeTheWrongOne) {
  Room room(2);
  room.TurnAboutTheVertical(1);
  const auto found = room.Find(kDoubtful);
  for (const std::size_t i : {0, 1}) {
    ASSERT_TRUE(found[i].has_value());
    EXPECT_EQ(found[i]->other, 1 - i);
    EXPECT_LT(found[i]->log_odds, 0);
    EXPECT_GT(found[i]->share, 0.01);
    EXPECT_FALSE(room.Find(std::exp(-found[i]->log_odds) * 1.01)[i].has_value());
  }
  // Turned together, they agree.
  room.TurnAboutTheVertical(0);
  EXPECT_FALSE(room.Find(kDoubtful)[0].has_value());
}

TEST(FindFreeSpaceViolations, OfSeveralTheWrongOneAlone) {
  Room room(5);
  room.TurnAboutTheVertical(3);
  const auto found = room.Find();
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(found[i].has_value(), i == 3) << i;
}

// The third sees nothing but the row.
TEST(FindFreeSpaceViolations, OfTwoThatNoOtherTellsApartEitherMayBeTheWrongOne) {
  Room room(2);
  room.TurnAboutTheVertical(1);
  room.views.push_back(room.views[0]);
  room.poses.push_back(room.poses[0]);
  DepthImage& depth = room.views[2].depth;
  const ExpectedView seen = CastView(room.rig.structure, room.views[2].rays, room.poses[2]);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!(seen.depth[i] > 0)) depth[i] = 0;
  }
  const auto found = room.Find(kDoubtful);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found[i].has_value(), i < 2) << i;
}

TEST(FindFreeSpaceViolations, ASensorWithoutAPoseTakesNoPart) {
  Room room(3);
  room.TurnAboutTheVertical(2);
  const auto found = FindFreeSpaceViolations({&room.views[0], &room.views[1], nullptr}, room.poses,
                                             room.rig.structure, kRefuting, 1);
  for (const auto& each : found) EXPECT_FALSE(each.has_value());
}

}  // namespace
}  // namespace volalign::arrangements_test
