#include "infer/refine/gauge.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::gauge_test {
namespace {

using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// Two sensors in two stills, the second in the second only, and boxes that stand anywhere. The
/// third frame is held; one box of the first still is not estimated.
struct Handmade {
  Structure structure = PaperStructure();
  SensorPoints nothing;
  RefineOptions options;
  std::vector<FrameInput> frames;
  Pose placement = Pose::Identity();
  Solution solution;

  Handmade() {
    placement.linear() = RotationExp({0, 0.7, 0});
    placement.translation() = Eigen::Vector3d(0.4, 0.01, -0.3);
    const std::vector<Pose> poses = {RingPose(20), RingPose(70), RingPose(140)};
    for (int i = 0; i < 3; ++i) {
      const Pose& pose = poses[static_cast<std::size_t>(i)];
      frames.push_back({testing_infer::Borrowed(nothing), pose, -1, i / 2, i == 0 ? 0 : 1});
    }
    const JointProblem problem = Problem();
    solution.state = NominalState(structure, poses, problem.lenses, problem.frame_of,
                                  {Pose::Identity(), placement});
    for (std::vector<double>& still : solution.state.boxes) {
      for (double& value : still) value = 0.001 * next_++;
    }
    solution.state.UpdateBuilt(problem.model);
    solution.free.boxes = {1, 1, 0, 1, 1, 1, 1, 1};
    solution.held = {0, 0, 1};
    solution.observed.resize(3);
  }
  JointProblem Problem() const { return {structure, frames, options, {}, 2}; }

 private:
  int next_ = 1;
};

Pose SensorFromBox(const State& state, std::size_t frame, std::size_t box) {
  return state.poses[frame].ToPose().inverse() * state.Built(frame).boxes()[box].structure_from_box;
}

Pose FirstFromSensor(const State& state, std::size_t frame) {
  return state.placements[state.StillOf(frame)].ToPose() * state.poses[frame].ToPose();
}

TEST(CentreBoxes, MovesNothingAgainstAnythingElse) {
  Handmade made;
  const State before = made.solution.state;
  CentreBoxes(made.Problem(), &made.solution);
  const State& after = made.solution.state;
  for (std::size_t still = 0; still < 2; ++still) {
    double x = 0, z = 0;
    for (int b = 0; b < 4; ++b) {
      const auto k = static_cast<std::size_t>(b);
      const auto at = [&](const State& state, int parameter) {
        return state.boxes[still][static_cast<std::size_t>(parameter)];
      };
      EXPECT_EQ(at(after, BuildModel::Yaw(b)), at(before, BuildModel::Yaw(b)));
      if (!made.solution.free.boxes[4 * still + k]) {
        EXPECT_EQ(at(after, BuildModel::X(b)), at(before, BuildModel::X(b)));
        EXPECT_EQ(at(after, BuildModel::Z(b)), at(before, BuildModel::Z(b)));
        continue;
      }
      x += at(after, BuildModel::X(b));
      z += at(after, BuildModel::Z(b));
      EXPECT_TRUE(SensorFromBox(after, still, k).isApprox(SensorFromBox(before, still, k), 1e-12))
          << still << " " << b;
    }
    EXPECT_NEAR(x, 0, 1e-15);
    EXPECT_NEAR(z, 0, 1e-15);
  }
  const auto second_from_first = [](const State& state) -> Pose {
    return FirstFromSensor(state, 1).inverse() * FirstFromSensor(state, 0);
  };
  EXPECT_TRUE(second_from_first(after).isApprox(second_from_first(before), 1e-12));
  EXPECT_TRUE(after.placements[0].ToPose().isApprox(Pose::Identity(), 1e-15));
  EXPECT_TRUE(after.poses[2].ToPose().isApprox(made.frames[2].start, 1e-12));
}

TEST(CentreBoxes, LeavesAStillToABoxThatIsSeenWhereItBelongs) {
  Handmade made;
  // A side of the box that is not estimated.
  FaceObservation face;
  for (face.label = 1; made.structure.SideOfLabel(face.label).box != 2;) ++face.label;
  made.solution.observed[0].faces = {face};
  const State before = made.solution.state;
  CentreBoxes(made.Problem(), &made.solution);
  const State& after = made.solution.state;
  EXPECT_EQ(after.boxes[0], before.boxes[0]);
  EXPECT_TRUE(after.poses[0].ToPose().isApprox(before.poses[0].ToPose(), 1e-15));
  EXPECT_NE(after.boxes[1], before.boxes[1]) << "all boxes of the other still are estimated";
}

}  // namespace
}  // namespace volalign::refine_internal::gauge_test
