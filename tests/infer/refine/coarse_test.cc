#include "infer/refine/coarse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::coarse_test {
namespace {

using testing_infer::Displaced;
using testing_infer::PaperStructure;
using testing_infer::PointsOf;
using testing_infer::Rig;
using testing_infer::RingPose;

TEST(CoarseGates, Tighten) {
  const Gates first = CoarseGates(0), second = CoarseGates(1), last = CoarseGates(9);
  EXPECT_DOUBLE_EQ(first.side, 0.15);
  EXPECT_DOUBLE_EQ(first.overlap, 0.12);
  EXPECT_NEAR(std::acos(first.min_cosine) * 180 / M_PI, 45, 1e-9);
  EXPECT_DOUBLE_EQ(second.side, 0.09);
  EXPECT_NEAR(std::acos(second.min_cosine) * 180 / M_PI, 27, 1e-9);
  EXPECT_DOUBLE_EQ(last.side, 0.06);
  EXPECT_DOUBLE_EQ(last.overlap, 0.02);
  EXPECT_NEAR(std::acos(last.min_cosine) * 180 / M_PI, 20, 1e-9);
}

TEST(SolveCoarse, BringsPosesNearTheTruth) {
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("A", RingPose(40));
  rig.Add("B", RingPose(85));
  const std::vector<SensorPoints> points = PointsOf(rig);
  std::vector<FrameInput> frames;
  for (std::size_t i = 0; i < 2; ++i) {
    const Pose start = Displaced(*rig.frames[i].ground_truth, 0.05, 3, i);
    frames.push_back({testing_infer::Borrowed(points[i]), start, start, start});
  }
  const RefineOptions options;
  const JointProblem problem(rig.structure, frames, options);
  const State state =
      SolveCoarse(problem, {0, 0}, NominalState(rig.structure, {frames[0].start, frames[1].start}));
  for (std::size_t i = 0; i < 2; ++i) {
    const PoseError error = ComparePoses(state.poses[i].ToPose(), *rig.frames[i].ground_truth);
    EXPECT_FALSE(!(error.translation_m < 5e-3)) << error.translation_m;
    EXPECT_FALSE(!(error.rotation_deg < 0.3)) << error.rotation_deg;
    EXPECT_EQ(state.offsets[i], 0) << "the poses alone";
  }
  EXPECT_EQ(state.size, 0);
  for (const double x : state.boxes[0]) EXPECT_EQ(x, 0);
}

}  // namespace
}  // namespace volalign::refine_internal::coarse_test
