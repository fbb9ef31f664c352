#include "infer/refine/fine_problem.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "infer/refine/fine.h"
#include "infer/refine/posterior.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::fine_problem_test {
namespace {

using testing_infer::Neighbours;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

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
  return static_cast<int>(OverlapBlocks(ceres, state).size());
}

TEST(BuildFineProblem, CountsOverlapFromMinOverlapOn) {
  const Neighbours made;
  const auto terms = [&](double min_overlap) {
    RefineOptions options;
    options.min_overlap = min_overlap;
    const JointProblem problem(made.rig.structure, made.frames, options);
    State state = NominalState(made.rig.structure, made.poses);
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
    const CeresProblem ceres =
        BuildFineProblem(problem, observed, {0, 0}, problem.layout.Constant(free), &state);
    return OverlapTerms(ceres, state);
  };
  EXPECT_GT(terms(0.05), 20);
  EXPECT_EQ(terms(0.05), terms(0.01));
  EXPECT_EQ(terms(0.95), 0) << "neighbours do not see nearly all of each other's view";
}

/// Two rows of points of a plane that faces the sensor, along the image's x or y axis: 1.2 m, of 2
/// m away four correlation lengths of 0.15 rad.
std::vector<CloudPoint> Strip(bool along_x, double z, int count = 15) {
  std::vector<CloudPoint> cloud;
  for (int i = 0; i < count; ++i) {
    for (const double across : {0.02, 0.1}) {
      const double along = 0.01 + 1.162 / (count - 1) * i;
      CloudPoint point;
      point.p = along_x ? Eigen::Vector3d(along, across, z) : Eigen::Vector3d(across, along, z);
      point.normal = {0, 0, -1};
      point.use = BlockUse::kFit;
      cloud.push_back(point);
    }
  }
  return cloud;
}

/// Of two frames whose smooth errors have that length.
std::vector<FrameObservations> TwoFrames() {
  std::vector<FrameObservations> observed(2);
  for (FrameObservations& of : observed) of.noise.depth.smooth_rad = 0.15;
  return observed;
}

/// Standard deviation of the difference of two points at 2 m, m: of the smooth error of both, and
/// of two thousandths of their distances from the optical axis.
double SigmaOfPair(const Eigen::Vector3d& p, double warp = 0.005) {
  return std::sqrt(2 * (warp * warp + 0.002 * 0.002 * p.head<2>().squaredNorm()));
}

TEST(BuildFineProblem, ErrorsWithinACorrelationLengthAreOneError) {
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
    const CeresProblem ceres =
        BuildFineProblem(problem, observed, {0, 0}, problem.layout.Constant(free), &state);
    double cost = 0;
    for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state)) {
      double of_block = 0;
      ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(block, true, &of_block, nullptr, nullptr));
      cost += of_block;
    }
    // Both ways together, 60 matches count as four.
    double expected = 0;
    for (const CloudPoint& point : a.cloud()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 0.5 * kApart * kApart / (sigma * sigma) * 4 / 30;
    }
    EXPECT_NEAR(cost, expected, 0.01 * expected) << along_x;
  }
}

TEST(BuildFineProblem, APairCountsBothWaysOrNot) {
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
    const CeresProblem ceres =
        BuildFineProblem(problem, std::vector<FrameObservations>(2), {0, 0},
                         problem.layout.Constant(AskedFor({}, problem.priors, 2, 4)), &state);
    return OverlapTerms(ceres, state);
  };
  EXPECT_EQ(terms(0.1), 60) << "60 of 460";
  EXPECT_EQ(terms(0.2), 0);
}

TEST(BuildFineProblem, OverlapIsOfCorrectedDepths) {
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
  const std::vector<FrameObservations> observed(2);
  const CeresProblem ceres =
      BuildFineProblem(problem, observed, {0, 0}, problem.layout.Constant(free), &state);
  const std::vector<ceres::ResidualBlockId> blocks = OverlapBlocks(ceres, state);
  ASSERT_GT(blocks.size(), 20u);
  double cost = 0;
  const auto sum = [&] {
    double all = 0;
    for (const ceres::ResidualBlockId& block : blocks) {
      EXPECT_TRUE(ceres.problem->EvaluateResidualBlock(block, false, &cost, nullptr, nullptr));
      all += cost;
    }
    return all;
  };
  EXPECT_NEAR(sum(), 0, 1e-9);
  state.gains[0] = 0;
  EXPECT_GT(sum(), 5) << "60 times 6 mm, of a standard deviation of 7";
}

TEST(GatherObservations, TrustsTheKindWhereNothingIsMeasured) {
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
    State state = NominalState(structure, {pose, pose});
    const FreeSet free = AskedFor({}, problem.priors, 2, 4);
    const std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
    const CeresProblem ceres =
        BuildFineProblem(problem, observed, {0, 0}, problem.layout.Constant(free), &state);
    // A step back of the first, m, in standard deviations of the first match, on the axis.
    constexpr double kStep = 0.001;
    state.offsets[0] = kStep;
    double residual = 0;
    ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(OverlapBlocks(ceres, state).front(), false,
                                                     nullptr, &residual, nullptr));
    const double expected = kStep / SigmaOfPair({0, 0, 2}, ErrorsOf("").smooth_m);
    EXPECT_NEAR(std::abs(residual), expected, 0.02 * expected) << kind;
  }
}

TEST(BuildFineProblem, TheLossBendsAtTwoSigmasHoweverManyMatchesThereAre) {
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
    const CeresProblem ceres =
        BuildFineProblem(problem, observed, {0, 0}, problem.layout.Constant(free), &state);
    const std::vector<ceres::ResidualBlockId> blocks = OverlapBlocks(ceres, state);
    const double share = 4 / static_cast<double>(blocks.size());
    int outliers = 0;
    for (const ceres::ResidualBlockId& block : blocks) {
      double residual = 0, plain = 0, robust = 0;
      ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(block, false, &plain, &residual, nullptr));
      ASSERT_TRUE(ceres.problem->EvaluateResidualBlock(block, true, &robust, nullptr, nullptr));
      EXPECT_NEAR(robust, share * 2 * std::log1p(residual * residual / 4), 1e-9);
      if (std::abs(residual) < 1e-6) continue;
      ++outliers;
      // In sigmas: most on the axis, and less at the border.
      EXPECT_GT(std::abs(residual), kOff / SigmaOfPair({1.2, 0.1, 2}));
      EXPECT_LT(std::abs(residual), kOff / SigmaOfPair({0, 0, 2}) * 1.03);
    }
    EXPECT_GT(outliers, count / 9);
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
    const Solution solution{AskedFor({}, problem.priors, 2, 4),
                            NominalState(structure, {pose, pose}),
                            TwoFrames(),
                            {0, 0}};
    double expected = 1 / (problem.priors.offset * problem.priors.offset);
    for (const CloudPoint& point : a.cloud()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 4 / (sigma * sigma) / static_cast<double>(a.cloud().size());
    }
    const Eigen::Index column = problem.layout.Offset(0);
    EXPECT_NEAR(ComputeNormalEquations(problem, solution).information(column, column), expected,
                0.01 * expected);
  }
}

TEST(BuildFineProblem, HoldsWhatIsNotFree) {
  const Neighbours made;
  const RefineOptions options;
  const JointProblem problem(made.rig.structure, made.frames, options);
  State state = NominalState(made.rig.structure, made.poses);
  FreeSet free = AskedFor({}, problem.priors, 2, 4);
  free.size = true;
  free.offset[1] = 1;
  const std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
  const CeresProblem ceres =
      BuildFineProblem(problem, observed, {1, 0}, problem.layout.Constant(free, {1, 0}), &state);
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
}  // namespace volalign::refine_internal::fine_problem_test
