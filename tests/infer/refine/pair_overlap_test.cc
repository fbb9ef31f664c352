#include "infer/refine/pair_overlap.h"

#include <gtest/gtest.h>

#include <vector>

#include "core/geometry/sensor_kind.h"
#include "infer/refine/solution.h"
#include "tests/infer/refine/two_sensors.h"

namespace volalign::refine_internal::pair_overlap_test {
namespace {

TEST(FindOverlaps, TrustsTheKindWhereNothingIsMeasured) {
  testing_infer::TwoSensors two(testing_infer::Strip(true, 2), testing_infer::Strip(true, 2));
  SensorLens lens;
  for (FrameInput& frame : two.frames) frame.lens = 0;
  for (const char* kind : {"realsense_d415", "kinect_v1", "azure_kinect"}) {
    lens.sensor = kind;
    const JointProblem problem(two.structure, two.frames, two.options, {lens});
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, GatherObservations(problem, two.state, free, {}), {0, 0}, two.state);
    ASSERT_EQ(overlaps.size(), 1u);
    const PairMatch& match = overlaps[0].of_a.at(0);
    const double expected = testing_infer::SigmaOfPair(match.point->p, ErrorsOf("").smooth_m);
    EXPECT_NEAR(match.sigma, expected, 0.02 * expected) << kind;
  }
}

TEST(FindOverlaps, SaysHowManyMeasurementsTheMatchesAreAndHowFarTheySpread) {
  // 60 matches in four cells of the errors, all of them 20 mm off.
  constexpr double kApart = 0.02;  // m
  const testing_infer::TwoSensors two(testing_infer::Strip(true, 2),
                                      testing_infer::Strip(true, 2 + kApart));
  const std::vector<PairOverlap> overlaps =
      FindOverlaps(two.Problem(), testing_infer::TwoFrames(), {0, 0}, two.state);
  ASSERT_EQ(overlaps.size(), 1u);
  EXPECT_EQ(overlaps[0].of_a.size(), 30u);
  EXPECT_EQ(overlaps[0].of_b.size(), 30u);
  EXPECT_NEAR(overlaps[0].cells, 4, 0.1);
  for (const PairMatch& match : overlaps[0].of_a) EXPECT_NEAR(match.residual, kApart, 1e-9);
  // The median of the sizes is that of a point halfway along.
  const double median = kApart / testing_infer::SigmaOfPair({0.6, 0.06, 2});
  EXPECT_NEAR(overlaps[0].excess, 1.4826 * median, 0.1 * median);
}

TEST(FindOverlaps, CountsWhatManyFramesSeeOnce) {
  const testing_infer::TwoSensors two(testing_infer::Strip(true, 2), testing_infer::Strip(true, 2));
  for (const std::size_t n : {2, 3, 5}) {
    const std::vector<FrameInput> frames(n, two.frames[0]);
    const JointProblem problem(two.structure, frames, two.options);
    const State state = NominalState(two.structure, std::vector<Pose>(n, two.pose));
    const std::vector<FrameObservations> observed(n, testing_infer::TwoFrames()[0]);
    const std::vector<PairOverlap> overlaps =
        FindOverlaps(problem, observed, std::vector<char>(n, 0), state);
    ASSERT_EQ(overlaps.size(), n * (n - 1) / 2);
    for (const PairOverlap& pair : overlaps)
      EXPECT_NEAR(pair.cells, 4 * 2.0 / static_cast<double>(n), 0.1);
  }
}

TEST(FindOverlaps, LeavesOutAHeldFrame) {
  testing_infer::Neighbours made;
  const RefineOptions options;
  const auto pairs = [&](const std::vector<char>& held) {
    const JointProblem problem(made.rig.structure, made.frames, options);
    const State state = NominalState(made.rig.structure, made.poses);
    return FindOverlaps(problem, std::vector<FrameObservations>(2), held, state).size();
  };
  EXPECT_EQ(pairs({0, 0}), 1u);
  EXPECT_EQ(pairs({1, 0}), 0u);
}

}  // namespace
}  // namespace volalign::refine_internal::pair_overlap_test
