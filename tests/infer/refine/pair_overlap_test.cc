#include "infer/refine/pair_overlap.h"

#include <gtest/gtest.h>

#include <vector>

#include "core/geometry/sensor_kind.h"
#include "infer/refine/solution.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/refine/strip.h"

namespace volalign::refine_internal::pair_overlap_test {
namespace {

using testing_infer::Neighbours;
using testing_infer::PaperStructure;
using testing_infer::RingPose;
using testing_infer::SigmaOfPair;
using testing_infer::Strip;
using testing_infer::TwoFrames;

TEST(FindOverlaps, TrustsTheKindWhereNothingIsMeasured) {
  // Two sensors without structure terms.
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  const SensorPoints a({}, {}, Strip(true, 2)), b({}, {}, Strip(true, 2));
  const std::vector<FrameInput> frames = {
      {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap, 0},
      {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap, 0}};
  const RefineOptions options;
  SensorLens lens;
  for (const char* kind : {"realsense_d415", "kinect_v1", "azure_kinect"}) {
    lens.sensor = kind;
    const JointProblem problem(structure, frames, options, {lens});
    const State state = NominalState(structure, {pose, pose});
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, GatherObservations(problem, state, free, {}), {0, 0}, state);
    ASSERT_EQ(overlaps.size(), 1u);
    const PairMatch& match = overlaps[0].of_a.at(0);
    const double expected = SigmaOfPair(match.point->p, ErrorsOf("").smooth_m);
    EXPECT_NEAR(match.sigma, expected, 0.02 * expected) << kind;
  }
}

TEST(FindOverlaps, SaysHowManyMeasurementsTheMatchesAreAndHowFarTheySpread) {
  // 60 matches in four cells of the errors, all of them 20 mm off.
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  constexpr double kApart = 0.02;  // m
  const SensorPoints a({}, {}, Strip(true, 2)), b({}, {}, Strip(true, 2 + kApart));
  const std::vector<FrameInput> frames = {
      {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap},
      {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap}};
  const RefineOptions options;
  const JointProblem problem(structure, frames, options);
  const std::vector<PairOverlap> overlaps =
      FindOverlaps(problem, TwoFrames(), {0, 0}, NominalState(structure, {pose, pose}));
  ASSERT_EQ(overlaps.size(), 1u);
  EXPECT_EQ(overlaps[0].of_a.size(), 30u);
  EXPECT_EQ(overlaps[0].of_b.size(), 30u);
  EXPECT_NEAR(overlaps[0].cells, 4, 0.1);
  for (const PairMatch& match : overlaps[0].of_a) EXPECT_NEAR(match.residual, kApart, 1e-9);
  // The median of the sizes is that of a point halfway along.
  const double median = kApart / SigmaOfPair({0.6, 0.06, 2});
  EXPECT_NEAR(overlaps[0].excess, 1.4826 * median, 0.1 * median);
}

TEST(FindOverlaps, LeavesOutAHeldFrameUnlessOnlyOverlapHoldsTheOther) {
  Neighbours made;
  const RefineOptions options;
  const auto pairs = [&](const std::vector<char>& held) {
    const JointProblem problem(made.rig.structure, made.frames, options);
    const State state = NominalState(made.rig.structure, made.poses);
    return FindOverlaps(problem, std::vector<FrameObservations>(2), held, state).size();
  };
  EXPECT_EQ(pairs({0, 0}), 1u);
  EXPECT_EQ(pairs({1, 0}), 0u);
  made.frames[1].role = FrameRole::kOverlap;
  EXPECT_EQ(pairs({1, 0}), 1u);
}

}  // namespace
}  // namespace volalign::refine_internal::pair_overlap_test
