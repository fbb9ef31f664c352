#include "infer/refine/terms.h"

#include <ceres/cost_function.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "infer/refine/posterior.h"
#include "infer/refine/solution.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/refine/two_sensors.h"

namespace volalign::refine_internal::terms_test {
namespace {

using testing_infer::Neighbours;
using testing_infer::SigmaOfPair;
using testing_infer::Strip;
using testing_infer::TwoFrames;
using testing_infer::TwoSensors;

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

double OverlapCost(const CeresProblem& ceres, const State& state) {
  double all = 0, cost = 0;
  for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state)) {
    EXPECT_TRUE(ceres.problem->EvaluateResidualBlock(block, false, &cost, nullptr, nullptr));
    all += cost;
  }
  return all;
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
  constexpr double kApart = 0.0005;  // m
  for (const bool along_x : {true, false}) {
    TwoSensors two(Strip(along_x, 2), Strip(along_x, 2 + kApart));
    const JointProblem problem = two.Problem();
    const CeresProblem ceres =
        Build(problem, TwoFrames(), AskedFor({}, problem.priors, 2, 4), &two.state);
    // Both ways together, 60 matches count as four.
    double expected = 0;
    for (const CloudPoint& point : two.a.cloud.points()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 0.5 * kApart * kApart / (sigma * sigma) * 4 / 30;
    }
    EXPECT_NEAR(OverlapCost(ceres, two.state), expected, 0.01 * expected) << along_x;
  }
}

TEST(BuildCeresProblem, APairCountsBothWaysOrNot) {
  // a sees nothing but what b sees, too; that is a fourteenth of what b sees.
  std::vector<CloudPoint> wide = Strip(true, 2);
  for (int i = 0; i < 400; ++i) {
    CloudPoint point;
    point.p = {-2 + 0.01 * i, 1.5, 4};
    point.normal = {0, 0, -1};
    wide.push_back(point);
  }
  TwoSensors two(Strip(true, 2), wide);
  const auto terms = [&](double min_overlap) {
    two.options.min_overlap = min_overlap;
    const JointProblem problem = two.Problem();
    const CeresProblem ceres = Build(problem, std::vector<FrameObservations>(2),
                                     AskedFor({}, problem.priors, 2, 4), &two.state);
    return OverlapTerms(ceres, two.state);
  };
  EXPECT_EQ(terms(0.1), 60) << "60 of 460";
  EXPECT_EQ(terms(0.2), 0);
}

TEST(BuildCeresProblem, OverlapIsOfCorrectedDepths) {
  // Both see one plane at 2 m, each with a depth error that is known.
  TwoSensors two(Strip(true, 2 / 1.003), Strip(true, 2 - 0.004));
  const JointProblem problem = two.Problem();
  two.state.gains[0] = 0.003;
  two.state.offsets[1] = 0.004;
  const FreeSet free = AskedFor(ParseEstimate("depth_gain,depth_offset"), problem.priors, 2, 4);
  const CeresProblem ceres = Build(problem, TwoFrames(), free, &two.state);
  ASSERT_EQ(OverlapTerms(ceres, two.state), 60);
  EXPECT_NEAR(OverlapCost(ceres, two.state), 0, 1e-9);
  two.state.gains[0] = 0;
  double expected = 0;  // 6 mm at each point, of four cells
  for (const CloudPoint& point : two.a.cloud.points()) {
    const double r = 0.006 / SigmaOfPair(point.p);
    expected += 4 * 2 * std::log1p(r * r / 4) / static_cast<double>(two.a.cloud.points().size());
  }
  EXPECT_NEAR(OverlapCost(ceres, two.state), expected, 0.02 * expected);
}

TEST(BuildCeresProblem, TheLossBendsAtTwoSigmasHoweverManyMatchesThereAre) {
  constexpr double kOff = 0.03;  // m, of one point in nine
  for (const int count : {15, 150}) {
    std::vector<CloudPoint> with_outliers = Strip(true, 2, count);
    for (std::size_t k = 4; k < with_outliers.size(); k += 9) with_outliers[k].p.z() -= kOff;
    TwoSensors two(Strip(true, 2, count), with_outliers);
    const JointProblem problem = two.Problem();
    const std::vector<PairOverlap> overlaps = FindOverlaps(problem, TwoFrames(), {0, 0}, two.state);
    const CeresProblem ceres =
        Build(problem, TwoFrames(), AskedFor({}, problem.priors, 2, 4), &two.state);
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
    EXPECT_NEAR(OverlapCost(ceres, two.state), expected, 1e-9);
  }
}

TEST(ComputeNormalEquations, CountWhatTheCostCounts) {
  // Four cells of errors tell a depth offset as four measurements do, from however many matches.
  for (const int count : {15, 150}) {
    const TwoSensors two(Strip(true, 2, count), Strip(true, 2, count));
    const JointProblem problem = two.Problem();
    Solution solution{AskedFor({}, problem.priors, 2, 4), two.state, TwoFrames(), {0, 0}};
    solution.overlaps = FindOverlaps(problem, solution.observed, solution.held, solution.state);
    double expected = 1 / (problem.priors.offset * problem.priors.offset);
    for (const CloudPoint& point : two.a.cloud.points()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 4 / (sigma * sigma) / static_cast<double>(two.a.cloud.points().size());
    }
    const Eigen::Index column = problem.layout.Offset(0);
    EXPECT_NEAR(ComputeNormalEquations(problem, solution).information(column, column), expected,
                0.01 * expected);
  }
}

// Where the depth of a point has bounced light, what two frames share says something of it.
TEST(ComputeNormalEquations, OverlapTellsBouncedLight) {
  const TwoSensors two(Strip(true, 2), Strip(true, 2));
  const JointProblem problem = two.Problem();
  Solution solution{AskedFor({}, problem.priors, 2, 4), two.state, {}, {0, 0}};
  solution.observed = testing_infer::TwoFrames();
  solution.overlaps = FindOverlaps(problem, solution.observed, solution.held, solution.state);
  const auto told = [&](double share) {
    for (PairMatch& match : solution.overlaps.at(0).of_a) match.bounced_point = share;
    const Eigen::Index column = problem.layout.FrameErrors(0) + kBounced;
    return ComputeNormalEquations(problem, solution).information(column, column);
  };
  const double nothing = told(0), all = told(1) - nothing;
  EXPECT_GT(all, 0);
  EXPECT_NEAR(told(0.5) - nothing, 0.25 * all, 1e-6 * all);
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
