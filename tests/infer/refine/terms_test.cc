#include "infer/refine/terms.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "infer/refine/posterior.h"
#include "infer/refine/solution.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/refine/strip.h"

namespace volalign::refine_internal::terms_test {
namespace {

using testing_infer::Neighbours;
using testing_infer::PaperStructure;
using testing_infer::RingPose;
using testing_infer::SigmaOfPair;
using testing_infer::Strip;
using testing_infer::TwoFrames;

/// The problem at `state`, with the overlap that there is at it.
CeresProblem Build(const JointProblem& problem, const std::vector<FrameObservations>& observed,
                   const FreeSet& free, State* state, const std::vector<char>& held = {0, 0}) {
  return BuildCeresProblem(problem, observed, FindOverlaps(problem, observed, held, *state), held,
                           problem.layout.Constant(free, held), state);
}

/// Residual blocks of overlap: those that two poses have in common.
std::vector<ceres::ResidualBlockId> OverlapBlocks(const CeresProblem& ceres, const State& state) {
  std::vector<ceres::ResidualBlockId> blocks, common;
  ceres.problem->GetResidualBlocksForParameterBlock(state.poses[0].values, &blocks);
  for (const ceres::ResidualBlockId& block : blocks) {
    std::vector<double*> parameters;
    ceres.problem->GetParameterBlocksForResidualBlock(block, &parameters);
    for (const double* parameter : parameters) {
      if (parameter == state.poses[1].values) common.push_back(block);
    }
  }
  return common;
}

int OverlapTerms(const CeresProblem& ceres, const State& state) {
  int terms = 0;
  for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state))
    terms += ceres.problem->GetCostFunctionForResidualBlock(block)->num_residuals();
  return terms;
}

TEST(BuildCeresProblem, CountsOverlapFromMinOverlapOn) {
  const Neighbours made;
  const auto terms = [&](double min_overlap) {
    RefineOptions options;
    options.min_overlap = min_overlap;
    const JointProblem problem(made.rig.structure, made.frames, options);
    State state = NominalState(made.rig.structure, made.poses);
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
    const CeresProblem ceres = Build(problem, observed, free, &state);
    return OverlapTerms(ceres, state);
  };
  EXPECT_GT(terms(0.05), 20);
  EXPECT_EQ(terms(0.05), terms(0.01));
  EXPECT_EQ(terms(0.95), 0) << "neighbours do not see nearly all of each other's view";
}

TEST(BuildCeresProblem, ErrorsWithinACorrelationLengthAreOneError) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  constexpr double kApart = 0.0005;  // m
  for (const bool along_x : {true, false}) {
    SensorPoints a({}, {}, Strip(along_x, 2)), b({}, {}, Strip(along_x, 2 + kApart));
    a.intrinsics = b.intrinsics = testing_infer::Kinect();
    const std::vector<FrameInput> frames = {
        {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap},
        {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap}};
    const RefineOptions options;
    const JointProblem problem(structure, frames, options);
    State state = NominalState(structure, {pose, pose});
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<FrameObservations> observed = TwoFrames();
    const CeresProblem ceres = Build(problem, observed, free, &state);
    double cost = 0;
    for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state)) {
      double of_block = 0;
      ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(block, true, &of_block, nullptr, nullptr));
      cost += of_block;
    }
    // Both ways together, 60 matches count as four.
    double expected = 0;
    for (const CloudPoint& point : a.cloud.points()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 0.5 * kApart * kApart / (sigma * sigma) * 4 / 30;
    }
    EXPECT_NEAR(cost, expected, 0.01 * expected) << along_x;
  }
}

TEST(BuildCeresProblem, APairCountsBothWaysOrNot) {
  // a sees nothing but what b sees, too; that is a fourteenth of what b sees.
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  std::vector<CloudPoint> wide = Strip(true, 2);
  for (int i = 0; i < 400; ++i) {
    CloudPoint point;
    point.p = {-2 + 0.01 * i, 1.5, 4};
    point.normal = {0, 0, -1};
    wide.push_back(point);
  }
  SensorPoints a({}, {}, Strip(true, 2)), b({}, {}, wide);
  const std::vector<FrameInput> frames = {
      {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap},
      {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap}};
  State state = NominalState(structure, {pose, pose});
  const auto terms = [&](double min_overlap) {
    RefineOptions options;
    options.min_overlap = min_overlap;
    const JointProblem problem(structure, frames, options);
    const CeresProblem ceres = Build(problem, std::vector<FrameObservations>(2),
                                     AskedFor({}, problem.priors, 2, 4), &state);
    return OverlapTerms(ceres, state);
  };
  EXPECT_EQ(terms(0.1), 60) << "60 of 460";
  EXPECT_EQ(terms(0.2), 0);
}

TEST(BuildCeresProblem, OverlapIsOfCorrectedDepths) {
  // Two sensors in one place see one plane at 2 m, each with a depth error that is known.
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  SensorPoints a({}, {}, Strip(true, 2 / 1.003)), b({}, {}, Strip(true, 2 - 0.004));
  a.intrinsics = b.intrinsics = testing_infer::Kinect();
  const std::vector<FrameInput> frames = {
      {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap},
      {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap}};
  const RefineOptions options;
  const JointProblem problem(structure, frames, options);
  State state = NominalState(structure, {pose, pose});
  state.gains[0] = 0.003;
  state.offsets[1] = 0.004;
  const FreeSet free = AskedFor(ParseEstimate("depth_gain,depth_offset"), problem.priors, 2, 4);
  const std::vector<FrameObservations> observed = TwoFrames();
  const CeresProblem ceres = Build(problem, observed, free, &state);
  const std::vector<ceres::ResidualBlockId> blocks = OverlapBlocks(ceres, state);
  ASSERT_EQ(OverlapTerms(ceres, state), 60);
  const auto sum = [&] {
    double all = 0, cost = 0;
    for (const ceres::ResidualBlockId& block : blocks) {
      EXPECT_TRUE(ceres.problem->EvaluateResidualBlock(block, false, &cost, nullptr, nullptr));
      all += cost;
    }
    return all;
  };
  EXPECT_NEAR(sum(), 0, 1e-9);
  state.gains[0] = 0;
  double expected = 0;  // 6 mm at each point, of four cells
  for (const CloudPoint& point : a.cloud.points()) {
    const double r = 0.006 / SigmaOfPair(point.p);
    expected += 4 * 2 * std::log1p(r * r / 4) / static_cast<double>(a.cloud.points().size());
  }
  EXPECT_NEAR(sum(), expected, 0.02 * expected);
}

TEST(BuildCeresProblem, TheLossBendsAtTwoSigmasHoweverManyMatchesThereAre) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  constexpr double kOff = 0.03;  // m, of one point in nine
  for (const int count : {15, 150}) {
    std::vector<CloudPoint> with_outliers = Strip(true, 2, count);
    for (std::size_t k = 4; k < with_outliers.size(); k += 9) with_outliers[k].p.z() -= kOff;
    SensorPoints a({}, {}, Strip(true, 2, count)), b({}, {}, with_outliers);
    const std::vector<FrameInput> frames = {
        {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap},
        {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap}};
    const RefineOptions options;
    const JointProblem problem(structure, frames, options);
    State state = NominalState(structure, {pose, pose});
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<FrameObservations> observed = TwoFrames();
    const std::vector<PairOverlap> overlaps = FindOverlaps(problem, observed, {0, 0}, state);
    const CeresProblem ceres = Build(problem, observed, free, &state);
    ASSERT_EQ(overlaps.size(), 1u);
    std::vector<PairMatch> matches = overlaps[0].of_a;
    matches.insert(matches.end(), overlaps[0].of_b.begin(), overlaps[0].of_b.end());
    const double share = 4 / static_cast<double>(matches.size());
    double expected = 0;
    int outliers = 0;
    for (const PairMatch& match : matches) {
      const double residual = match.residual / match.sigma;
      expected += share * 2 * std::log1p(residual * residual / 4);
      if (std::abs(residual) < 1e-6) continue;
      ++outliers;
      // In sigmas: most on the axis, and less at the border.
      EXPECT_GT(std::abs(residual), kOff / SigmaOfPair({1.2, 0.1, 2}));
      EXPECT_LT(std::abs(residual), kOff / SigmaOfPair({0, 0, 2}) * 1.03);
    }
    EXPECT_GT(outliers, count / 9);
    double cost = 0;
    for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state)) {
      double of_block = 0;
      ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(block, false, &of_block, nullptr, nullptr));
      cost += of_block;
    }
    EXPECT_NEAR(cost, expected, 1e-9);
  }
}

TEST(ComputeNormalEquations, CountWhatTheCostCounts) {
  // Four cells of errors tell a depth offset as four measurements do, from however many matches.
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(40);
  for (const int count : {15, 150}) {
    const SensorPoints a({}, {}, Strip(true, 2, count)), b({}, {}, Strip(true, 2, count));
    const std::vector<FrameInput> frames = {
        {testing_infer::Borrowed(a), pose, pose, pose, FrameRole::kOverlap},
        {testing_infer::Borrowed(b), pose, pose, pose, FrameRole::kOverlap}};
    const RefineOptions options;
    const JointProblem problem(structure, frames, options);
    Solution solution{AskedFor({}, problem.priors, 2, 4),
                      NominalState(structure, {pose, pose}),
                      TwoFrames(),
                      {0, 0}};
    solution.overlaps = FindOverlaps(problem, solution.observed, solution.held, solution.state);
    double expected = 1 / (problem.priors.offset * problem.priors.offset);
    for (const CloudPoint& point : a.cloud.points()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 4 / (sigma * sigma) / static_cast<double>(a.cloud.points().size());
    }
    const Eigen::Index column = problem.layout.Offset(0);
    EXPECT_NEAR(ComputeNormalEquations(problem, solution).information(column, column), expected,
                0.01 * expected);
  }
}

TEST(BuildCeresProblem, HoldsWhatIsNotFree) {
  const Neighbours made;
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.frames, options);
  State state = NominalState(made.rig.structure, made.poses);
  FreeSet free = AskedFor({}, problem.priors, 2, 4);
  free.size = true;
  free.offset[1] = 1;
  const std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
  const CeresProblem ceres = Build(problem, observed, free, &state, {1, 0});
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.poses[0].values));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.nuisances[0].data()));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(state.poses[1].values));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(&state.offsets[1]));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(&state.gains[1]));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(state.nuisances[1].data()));
  EXPECT_FALSE(ceres.problem->IsParameterBlockConstant(&state.size));
  EXPECT_TRUE(ceres.problem->IsParameterBlockConstant(state.boxes[0].data()));
  EXPECT_EQ(OverlapTerms(ceres, state), 0) << "one of the two stays where it is";
}

}  // namespace
}  // namespace volalign::refine_internal::terms_test
