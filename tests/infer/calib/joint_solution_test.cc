#include "infer/calib/joint_solution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>
#include <vector>

#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::joint_solution_test {
namespace {

using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// Three sensors that see the structure from one place: two that geometry has located, of which the
/// joint solution takes the second half a metre away, and one that a network has located, which it
/// takes there as well.
class Shapeless : public testing::Test {
 protected:
  void SetUp() override {
    Pose away = truth_;
    away.translation().x() += 0.5;
    std::vector<SensorView> views;
    std::vector<LocateResult> located;
    for (const bool geometry : {true, true, false}) {
      frames_[{0, views.size()}] = FrameInput();
      views.push_back(testing_infer::See(structure_, truth_));
      LocatedFrame frame;
      if (geometry) frame.shape_log_odds = 1;
      located.emplace_back(std::move(frame));
    }
    seen_.views = PerFrame<SensorView>({views});
    located_ = PerFrame<LocateResult>({located});
    refined_.placements.push_back({Pose::Identity(), {}, {}, structure_});
    for (const Pose& pose : {truth_, away, away}) {
      refined_.frames.emplace_back();
      refined_.frames.back().structure_from_sensor = pose;
    }
  }

  SomeFrames<Finding> Find() const { return FindShapeless(seen_, located_, frames_, refined_); }

  const Structure structure_ = PaperStructure();
  const Pose truth_ = RingPose(40);
  Seen seen_;
  PerFrame<LocateResult> located_;
  SomeFrames<FrameInput> frames_;
  RefineResult refined_;
};

TEST_F(Shapeless, IsASensorThatGeometryAloneLocated) {
  const SomeFrames<Finding> found = Find();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.at({0, 1}).code, SensorCode::kNoStructure);
}

// What was refined are the located frames alone.
TEST_F(Shapeless, FramesThatAreNotLocatedHaveNoPose) {
  located_[{0, 0}] = Finding();
  frames_.erase({0, 0});
  refined_.frames.erase(refined_.frames.begin());
  refined_.frames[0].structure_from_sensor = truth_;
  EXPECT_TRUE(Find().empty());
}

TEST(StandsStill, WhereAFrameMovesByLessThanItsPositionIsKnownTo) {
  RefinedFrame refined;
  for (const double sigma : {0.0001, 0.005}) {
    refined.covariance = sigma * sigma * Matrix6d::Identity();
    const double limit = std::max(0.002, sigma);
    EXPECT_TRUE(StandsStill(0.9 * limit, refined)) << sigma;
    EXPECT_FALSE(StandsStill(1.1 * limit, refined)) << sigma;
    EXPECT_FALSE(StandsStill(std::nan(""), refined)) << sigma;
  }
}

// One goes on, one turns back, one has just begun to move.
TEST(NextStarts, AreHalfWayForFramesThatTurnBack) {
  const FrameId on{0, 0}, back{0, 1}, fresh{1, 0};
  SomeFrames<FrameInput> frames;
  SomeFrames<Pose> poses;
  Moves moves, before;
  for (const FrameId id : {on, back, fresh}) {
    frames[id].start = RingPose(40);
    poses[id] = Pose(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY())) * RingPose(40);
    moves[id] = poses[id].translation() - frames[id].start.translation();
  }
  before[on] = moves[on];
  before[back] = -0.5 * moves[back];
  const SomeFrames<Pose> starts = NextStarts(frames, poses, moves, before);
  ASSERT_EQ(starts.size(), 3u);
  for (const FrameId id : {on, fresh})
    EXPECT_EQ(starts.at(id).matrix(), poses.at(id).matrix()) << id.still << " " << id.frame;
  const Pose& middle = starts.at(back);
  for (const Pose& end : {frames.at(back).start, poses.at(back)}) {
    const PoseError apart = ComparePoses(middle, end);
    EXPECT_NEAR(apart.translation_m, moves.at(back).norm() / 2, 1e-12);
    EXPECT_NEAR(apart.rotation_deg, 0.01 * 180 / M_PI, 1e-9);
  }
}

}  // namespace
}  // namespace volalign::joint_solution_test
