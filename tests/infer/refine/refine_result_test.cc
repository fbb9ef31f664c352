#include "infer/refine/refine_result.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "tests/core/base/expect_error.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::refine_result_test {
namespace {

using namespace testing_infer;

/// Two sensors that see the stack in two places, of it the same picture, with a posterior in which
/// everything is correlated with everything.
struct TwoCaptures {
  Neighbours neighbours;
  std::vector<FrameInput> frames;
  RefineOptions options;
  std::vector<SensorLens> lenses{2};  // the second is known
  std::vector<Pose> placements{Pose::Identity(), MakePose({0, 0.6, 0}, {0.4, 0, -0.3})};
  std::optional<JointProblem> problem;
  Agreed agreed;
  Posterior posterior;
  std::vector<char> unsolved = std::vector<char>(4, 0);

  TwoCaptures() {
    lenses[0].sensor = "kind";
    lenses[0].prior_sigmas = Eigen::Vector3d::Constant(0.01);
    for (std::size_t i = 0; i < 4; ++i) {
      FrameInput frame = neighbours.frames[i % 2];
      frame.sensor = static_cast<int>(i % 2);
      frame.capture = i / 2;
      frame.lens = i % 2;
      frames.push_back(frame);
    }
    problem.emplace(neighbours.rig.structure, frames, options, lenses, 2);
    std::vector<Pose> poses;
    for (const FrameInput& frame : frames) poses.push_back(frame.start);
    Solution& solution = agreed.solution;
    solution.state = NominalState(neighbours.rig.structure, poses, problem->lenses,
                                  problem->frame_of, placements);
    solution.free = AskedFor(ParseEstimate("boxes,size,depth_gain,depth_offset,lens"),
                             problem->priors, 4, problem->lenses);
    std::fill(solution.free.lens.begin(), solution.free.lens.end(), 0);
    solution.free.lens[0] = 1;
    solution.observed.resize(4);
    solution.fixed.assign(4, 0);
    agreed.of.resize(4);
    agreed.measured.resize(4);
    for (std::size_t i = 0; i < 4; ++i) {
      const double number = 1 + static_cast<double>(i);
      solution.state.offsets[i] = 0.001 * number;
      agreed.measured[i] = {{0.1 * number, 5}, {}};
    }
    solution.state.errors[0][kGain] = 0.002;
    solution.state.errors[1][kGain] = -0.001;
    solution.state.lenses[0] = LensChange(0.001, 0.002, 0.003);
    solution.state.size = 0.004;
    const Eigen::Index n = problem->layout.size();
    RandomStream random(11, 0, "posterior");
    Eigen::MatrixXd root(n, n);
    for (Eigen::Index k = 0; k < root.size(); ++k) root.data()[k] = 1e-5 * random.Normal();
    posterior.covariance = root * root.transpose();
  }

  void ForgetDepthErrors() {
    agreed.solution.state.offsets.assign(4, 0);
    agreed.solution.state.errors.assign(2, SensorErrorVector::Zero());
  }
  RefineResult Result() const {
    RefineResult result = MakeResult(*problem, agreed);
    AddUncertainties(*problem, agreed, unsolved, posterior, &result);
    return result;
  }
};

TEST(MakeResult, FramesAreTheStates) {
  TwoCaptures two;
  two.agreed.solution.fixed[2] = 1;
  const State& state = two.agreed.solution.state;
  const RefineResult result = two.Result();
  ASSERT_EQ(result.frames.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    const RefinedFrame& frame = result.frames[i];
    EXPECT_EQ(frame.solved, i != 2);
    EXPECT_TRUE(frame.structure_from_sensor.isApprox(state.poses[i].ToPose(), 1e-12));
    EXPECT_TRUE(frame.first_from_sensor.isApprox(
        two.placements[i / 2] * frame.structure_from_sensor, 1e-12));
    // Of a frame that stays, depth is as it was measured.
    EXPECT_NEAR(frame.depth_offset, i == 2 ? 0 : 0.001 * (static_cast<double>(i) + 1), 1e-12);
    EXPECT_NEAR(frame.depth_gain, i == 2 ? 1 : (i % 2 == 0 ? 1.002 : 0.999), 1e-12);
    EXPECT_EQ(frame.disagreement, two.agreed.measured[i].cost);
    EXPECT_FALSE(frame.refused_fit.has_value());
    EXPECT_EQ(frame.problem, "");
  }
}

TEST(MakeResult, WhatIsNotEstimatedIsNominal) {
  TwoCaptures two;
  FreeSet& free = two.agreed.solution.free;
  free.offset = free.gain = free.size = false;
  const RefineResult result = two.Result();
  for (const RefinedFrame& frame : result.frames) {
    EXPECT_EQ(frame.depth_offset, 0);
    EXPECT_EQ(frame.depth_gain, 1);
    EXPECT_GT(frame.sigma_depth_offset, 0) << "how well it is known is said all the same";
    EXPECT_GT(frame.sigma_depth_gain, 0);
  }
  EXPECT_FALSE(result.size_estimated);
}

TEST(MakeResult, NumbersThatFailedAreNamed) {
  TwoCaptures two;
  two.unsolved[1] = 1;
  EXPECT_TRUE(Has(two.Result().frames[1].problem, "not finite"));
  EXPECT_EQ(two.Result().frames[0].problem, "");
  two.posterior.exact = false;
  EXPECT_TRUE(Has(two.Result().frames[0].problem, "uncertainty"));
}

// A pose in the first still is the product of two that err together: a step of the pose counts
// there as the placement turns it.
TEST(MakeResult, CovarianceInTheFirstCaptureIsThatOfTheProduct) {
  const TwoCaptures two;
  const RefineResult result = two.Result();
  const ParameterLayout& layout = two.problem->layout;
  for (const std::size_t i : {0, 3}) {
    const RefinedFrame& frame = result.frames[i];
    Eigen::MatrixXd steps = Eigen::MatrixXd::Zero(6, layout.size());
    steps.middleCols<6>(layout.Pose(i)).setIdentity();
    const auto covariance = [&] {
      return Matrix6d(steps * two.posterior.covariance * steps.transpose());
    };
    EXPECT_TRUE(frame.covariance.isApprox(covariance(), 1e-9));
    steps.middleCols<6>(layout.Pose(i)) = Adjoint(two.placements[i / 2]);
    if (i / 2 > 0) steps.middleCols<6>(layout.Placement(i / 2)).setIdentity();
    EXPECT_TRUE(frame.first_covariance.isApprox(covariance(), 1e-9)) << i;
  }
}

// What a frame that disagrees reports is its own, whatever the joint solution has.
TEST(MakeResult, AnExcludedFrameKeepsItsOwn) {
  TwoCaptures two;
  two.agreed.solution.fixed[1] = 1;
  ExcludedFrame excluded;
  excluded.structure_from_sensor = RingPose(77);
  excluded.contradicts = {3, 0};
  excluded.alone = two.agreed.solution.state;
  excluded.alone.poses[1] = PoseBlock(RingPose(88));
  excluded.alone.offsets[1] = 0.02;
  excluded.alone.errors[1][kGain] = 0.03;
  excluded.covariance = 2e-6 * Matrix6d::Identity();
  two.agreed.of[1] = excluded;
  const RefinedFrame frame = two.Result().frames[1];
  EXPECT_TRUE(frame.solved);
  EXPECT_TRUE(frame.structure_from_sensor.isApprox(RingPose(88), 1e-12));
  EXPECT_TRUE(frame.covariance.isApprox(excluded.covariance, 1e-12));
  EXPECT_NEAR(frame.depth_offset, 0.02, 1e-12);
  EXPECT_NEAR(frame.depth_gain, 1.03, 1e-12);
  ASSERT_TRUE(frame.refused_fit.has_value());
  EXPECT_TRUE(frame.refused_fit->structure_from_sensor.isApprox(RingPose(77), 1e-12));
  EXPECT_EQ(frame.refused_fit->contradicts, (std::vector<int>{3, 0}));
}

TEST(MakeResult, PlacementsBoxesSizeAndLens) {
  TwoCaptures two;
  State& state = two.agreed.solution.state;
  state.boxes[1][static_cast<std::size_t>(BuildModel::X(2))] = 0.005;
  state.boxes[1][static_cast<std::size_t>(BuildModel::Z(2))] = -0.003;
  state.boxes[1][static_cast<std::size_t>(BuildModel::Yaw(2))] = 0.02;
  const RefineResult result = two.Result();
  ASSERT_EQ(result.placements.size(), 2u);
  EXPECT_TRUE(result.placements[0].covariance.isZero()) << "the first one is the frame itself";
  const Eigen::Index place = two.problem->layout.Placement(1);
  EXPECT_TRUE(result.placements[1].covariance.isApprox(
      two.posterior.covariance.block<6, 6>(place, place), 1e-12));
  EXPECT_TRUE(result.placements[1].first_from_placement.isApprox(two.placements[1], 1e-12));
  const RefinedBox& box = result.placements[1].boxes[2];
  EXPECT_EQ(box.x, 0.005);
  EXPECT_EQ(box.z, -0.003);
  EXPECT_EQ(box.yaw, 0.02);
  EXPECT_EQ(result.placements[0].boxes[2].x, 0);
  EXPECT_GT(box.sigma_x, 0);
  // No evidence has a face: no box is seen, and none was estimated.
  EXPECT_FALSE(box.estimated);
  FaceObservation face;
  face.label = LabelOf(two.neighbours.rig.structure,
                       two.neighbours.rig.structure.boxes()[2].name + "/front");
  two.agreed.solution.observed[3].faces = {face};
  EXPECT_TRUE(two.Result().placements[1].boxes[2].estimated);
  EXPECT_FALSE(two.Result().placements[1].boxes[1].estimated);
  EXPECT_FALSE(two.Result().placements[0].boxes[2].estimated) << "another capture";

  EXPECT_TRUE(result.size_estimated);
  EXPECT_NEAR(result.size_scale, 1.004, 1e-12);
  const auto sigma = [&](Eigen::Index column) {
    return std::sqrt(two.posterior.covariance(column, column));
  };
  EXPECT_NEAR(result.sigma_size_scale, sigma(two.problem->layout.Size()), 1e-12);
  ASSERT_EQ(result.lenses.size(), 2u);
  EXPECT_FALSE(result.lenses[1].estimated);
  EXPECT_TRUE(result.lenses[0].estimated);
  EXPECT_EQ(result.lenses[0].change, LensChange(0.001, 0.002, 0.003));
  EXPECT_NEAR(result.lenses[0].sigmas[1], sigma(two.problem->layout.Lens(0) + 1), 1e-12);
}

TEST(MakeResult, SizeIsEstimatedByFramesThatAreSolved) {
  TwoCaptures two;
  two.agreed.solution.fixed.assign(4, 1);
  EXPECT_FALSE(two.Result().size_estimated);
}

// Both captures show the same: each has the pair of its own frames, alike, and none across.
TEST(MakeResult, PairsAreOfOneCapture) {
  TwoCaptures two;
  two.ForgetDepthErrors();
  const std::vector<RefinedPair> pairs = two.Result().pairs;
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(std::make_pair(pairs[0].a, pairs[0].b), std::make_pair(0, 1));
  EXPECT_EQ(std::make_pair(pairs[1].a, pairs[1].b), std::make_pair(2, 3));
  EXPECT_NEAR(pairs[0].overlap, pairs[1].overlap, 1e-9);
  EXPECT_LT(pairs[0].rms, 0.005) << "exact pictures at true poses";
}

// What two frames of the joint solution err by alike does not move them against each other; one
// that is not of it errs by itself.
TEST(MakeResult, PairsHaveTheCovarianceOfTheDifference) {
  TwoCaptures two;
  two.ForgetDepthErrors();
  Eigen::MatrixXd difference = Eigen::MatrixXd::Zero(6, two.problem->layout.size());
  difference.middleCols<6>(two.problem->layout.Pose(3)).setIdentity();
  difference.middleCols<6>(two.problem->layout.Pose(2)) = -Matrix6d::Identity();
  const Matrix6d expected = difference * two.posterior.covariance * difference.transpose();
  EXPECT_TRUE(two.Result().pairs.at(1).covariance.isApprox(expected, 1e-9));
  two.agreed.of[3] = ExcludedFrame{{}, two.agreed.solution.state, 1e-6 * Matrix6d::Identity()};
  const RefineResult result = two.Result();
  EXPECT_TRUE(result.pairs.at(1).covariance.isApprox(
      result.frames[2].covariance + result.frames[3].covariance, 1e-12));
}

// Clouds that the same shift of one sensor moves apart, if all that is uncertain is that shift.
TEST(MakeResult, PredictsHowFarApartCloudsAre) {
  TwoCaptures two;
  State& state = two.agreed.solution.state;
  two.ForgetDepthErrors();
  for (FrameObservations& observed : two.agreed.solution.observed)
    observed.noise.depth.white_m = observed.noise.depth.smooth_m = 0;
  const ParameterLayout& layout = two.problem->layout;
  two.posterior.covariance.setZero();
  const double own = two.Result().pairs.at(1).predicted_rms;
  EXPECT_GT(own, 0.002) << "errors of the intrinsics";
  EXPECT_LT(own, 0.004);
  const auto predict = [&](Eigen::Index column, double sigma) {
    two.posterior.covariance.setZero();
    two.posterior.covariance(column, column) = sigma * sigma;
    return std::sqrt(Square(two.Result().pairs.at(1).predicted_rms) - Square(own));
  };
  double squares = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double one = predict(layout.Pose(2) + axis, 0.01);
    EXPECT_NEAR(predict(layout.Pose(3) + axis, 0.01), one, 1e-12);
    EXPECT_NEAR(predict(layout.Pose(2) + axis, 0.02), 2 * one, 1e-12);
    squares += one * one;
  }
  EXPECT_NEAR(std::sqrt(squares), 0.01, 1e-9) << "normals are of length 1";
  EXPECT_NEAR(predict(layout.Pose(0), 0.01), 0, 1e-9) << "of another capture";
  const double offset = predict(layout.Offset(2), 0.01);
  EXPECT_GT(offset, 0.004);
  EXPECT_LT(offset, 0.01 * 1.5) << "along rays up to 45 deg off the axis";
  EXPECT_GT(predict(layout.Error(2, kGain), 0.01), offset) << "everything is farther than 1 m";
  predict(layout.Pose(2), 0);
  two.agreed.solution.observed[3].noise.depth.white_m = 0.01;
  const double white = two.Result().pairs.at(1).predicted_rms;
  two.agreed.solution.observed[3].noise.depth.smooth_m = 0.01;
  EXPECT_GT(two.Result().pairs.at(1).predicted_rms, 1.2 * white);
  state.poses[3] = PoseBlock(Pose(Eigen::Translation3d(0, 5, 0) * state.poses[3].ToPose()));
  const RefinedPair apart = two.Result().pairs.at(1);
  EXPECT_EQ(apart.overlap, 0);
  EXPECT_TRUE(std::isnan(apart.rms) && std::isnan(apart.predicted_rms));
  EXPECT_TRUE(apart.covariance.allFinite()) << "what is known of their poses does not need overlap";
}

}  // namespace
}  // namespace volalign::refine_internal::refine_result_test
