#include "infer/refine/acceptance.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "infer/refine/solution.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::acceptance_test {
namespace {

using testing_infer::PaperStructure;
using testing_infer::RingPose;

TEST(IsBetter, RefusesWhatIsClearlyWorseByBothMeasures) {
  EXPECT_TRUE(IsBetter({0.9, 0.01, 5}, {1, 0.01, 5}));
  EXPECT_TRUE(IsBetter({1, 0.009, 5}, {1, 0.01, 5}));
  EXPECT_TRUE(IsBetter({2, 0.009, 5}, {1, 0.01, 5}));
  EXPECT_TRUE(IsBetter({1, 0.01, 5}, {1, 0.01, 5}));
  // A likelihood ratio of exp(5 / 2) = 12, and of exp(8 / 2) = 55.
  EXPECT_TRUE(IsBetter({2, 0.02, 5}, {1, 0.01, 5}));
  EXPECT_FALSE(IsBetter({2, 0.02, 8}, {1, 0.01, 8}));
  EXPECT_FALSE(IsBetter({0, 0, 0}, {1, 0.01, 5})) << "where it sees nothing, nothing is explained";
  EXPECT_TRUE(IsBetter({1, 0.01, 5}, {0, 0, 0}));
}

TEST(IsNoWorse, RefusesWhatIsWorseByBoth) {
  EXPECT_TRUE(IsNoWorse({1, 0.01, 5}, {1, 0.01, 5}));
  EXPECT_TRUE(IsNoWorse({2, 0.01, 5}, {1, 0.01, 5}));
  EXPECT_FALSE(IsNoWorse({2, 0.02, 5}, {1, 0.01, 5}));
  EXPECT_FALSE(IsNoWorse({0, 0, 0}, {0, 0, 0})) << "nothing speaks for it";
}

/// Observations of one side by a sensor that looks at it head on from 1.5 m, each with 1 mm of its
/// own.
struct HeadOn {
  Structure structure = PaperStructure();
  BuildModel model{structure};
  Pose pose;
  FrameObservations held_out;
  State state;

  HeadOn() {
    const int label = testing_infer::LabelOf(structure, "top/front");
    const Side& side = structure.SideOfLabel(label);
    pose = Pose::Identity();
    pose.linear() << side.axis_u.cross(-side.normal), side.axis_u, -side.normal;
    pose.linear().col(0) = pose.linear().col(1).cross(pose.linear().col(2));
    pose.translation() = side.centre + 1.5 * side.normal;
    for (int i = -2; i <= 2; ++i) {
      FaceObservation face;
      face.label = label;
      face.p = {0.01 * i, 0.005 * i, 1.5};
      held_out.faces.push_back(face);
    }
    held_out.face_root = 0.001 * Eigen::MatrixXd::Identity(5, 5);
    held_out.edge_root = Eigen::MatrixXd(0, 0);
    state = NominalState(structure, {pose});
  }
  Pose Nearer(double by) const {
    Pose moved = pose;
    moved.translation() += by * pose.linear().col(2);
    return moved;
  }
};

TEST(FitToStructure, IsTheMisfitUnderWhatIsUnknown) {
  HeadOn scene;
  Priors priors;  // nothing is unknown
  priors.gain = 0;
  const auto fit = [&](double nearer) {
    return FitToStructure(scene.model, priors, scene.state, 0, scene.Nearer(nearer),
                          scene.held_out);
  };
  EXPECT_NEAR(fit(0).misfit, 0, 1e-12);
  EXPECT_NEAR(fit(0.004).misfit, 4 * 4, 1e-6);
  EXPECT_NEAR(fit(0.004).distance, 0.004, 1e-9);
  // An unknown constant of 10 mm: all five are off by it alike, so that their mean square counts as
  // one number of variance 0.01^2 + 0.001^2 / 5.
  priors.offset = 0.01;
  EXPECT_NEAR(fit(0.004).misfit, 0.004 * 0.004 / (1e-4 + 1e-6 / 5) / 5, 1e-6);
  EXPECT_NEAR(fit(0.004).distance, 0.004, 1e-9);
  // The offset that was estimated is taken out of the plain distance.
  scene.state.offsets[0] = 0.004;
  EXPECT_NEAR(fit(-0.004).distance, 0, 1e-9);
}

/// Two sensors that see the structure, with nothing to be estimated beside the poses.
struct TwoSensors {
  testing_infer::Rig rig{PaperStructure(), {}, {}};
  std::vector<SensorPoints> points;
  std::vector<FrameInput> frames;
  RefineOptions options;

  TwoSensors() {
    rig.Add("A", RingPose(40));
    rig.Add("B", RingPose(85));
    points = testing_infer::PointsOf(rig);
    for (std::size_t i = 0; i < 2; ++i) {
      const Pose& truth = *rig.frames[i].ground_truth;
      const Pose away = testing_infer::Displaced(truth, 0.005, 0.2, i);
      frames.push_back({testing_infer::Borrowed(points[i]), away, away, truth});
    }
    options.estimate = "none";
  }
};

TEST(AcceptImproved, KeepsAndSendsBack) {
  TwoSensors two;
  // The first was to be kept where the truth is and "refined" away from it; the second the other
  // way round.
  two.frames[0].to_beat = two.frames[0].fallback = *two.rig.frames[0].ground_truth;
  two.frames[0].start = two.frames[0].fallback;
  two.frames[0].start.translation().y() += 0.005;
  const JointProblem problem(two.rig.structure, two.frames, two.options);
  Solution solution{AskedFor(ParseEstimate("none"), problem.priors, 2, 4),
                    NominalState(two.rig.structure, {two.frames[0].start, two.frames[1].start}),
                    std::vector<FrameObservations>(2),
                    {0, 0}};
  for (FrameObservations& observed : solution.observed) observed.noise.depth.smooth_m = 0.001;
  const Acceptance accepted = AcceptImproved(problem, solution);
  EXPECT_EQ(accepted.solution.held, (std::vector<char>{1, 0}));
  const Pose& truth = *two.rig.frames[0].ground_truth;
  EXPECT_TRUE(accepted.solution.state.poses[0].ToPose().isApprox(truth, 1e-12));
  EXPECT_TRUE(PerturbLeft(accepted.refused[0], truth).isApprox(two.frames[0].start, 1e-9));
  EXPECT_EQ(accepted.refused[1].norm(), 0);
}

TEST(AcceptImproved, JudgesByItsOwnPointsWhereNoneAreHeldOut) {
  for (const bool improved : {true, false}) {
    TwoSensors two;
    for (SensorPoints& points : two.points) {
      const auto out = [](const auto& point) { return point.use != BlockUse::kFit; };
      auto& sides = points.side_points;
      sides.erase(std::remove_if(sides.begin(), sides.end(), out), sides.end());
      auto& edges = points.edge_points;
      edges.erase(std::remove_if(edges.begin(), edges.end(), out), edges.end());
    }
    if (!improved) std::swap(two.frames[0].to_beat, two.frames[0].start);
    const JointProblem problem(two.rig.structure, two.frames, two.options);
    const FreeSet free = AskedFor(ParseEstimate("none"), problem.priors, 2, 4);
    State state = NominalState(two.rig.structure, {two.frames[0].start, two.frames[1].start});
    std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
    const Acceptance accepted = AcceptImproved(problem, {free, state, observed, {0, 0}});
    EXPECT_TRUE(GatherHeldOut(problem, {free, state, observed, {0, 0}})[0].faces.empty());
    EXPECT_EQ(accepted.solution.held, (std::vector<char>{!improved, 0}));
  }
}

TEST(HeldOutObservations, WhatFitsDoesNotAcceptPoses) {
  const TwoSensors two;
  TwoSensors without;
  for (SensorPoints& points : without.points) {
    const auto held_out = [](const auto& point) { return point.use == BlockUse::kAccept; };
    auto& sides = points.side_points;
    sides.erase(std::remove_if(sides.begin(), sides.end(), held_out), sides.end());
    auto& edges = points.edge_points;
    edges.erase(std::remove_if(edges.begin(), edges.end(), held_out), edges.end());
  }
  const auto count = [](const FrameObservations& of) { return of.faces.size() + of.edges.size(); };
  const auto observations = [&](const TwoSensors& of) {
    const JointProblem problem(of.rig.structure, of.frames, of.options);
    const FreeSet free = AskedFor(ParseEstimate("none"), problem.priors, 2, 4);
    const State state = NominalState(of.rig.structure, {of.frames[0].start, of.frames[1].start});
    const std::vector<FrameObservations> observed = GatherObservations(problem, state, free, {});
    return std::make_pair(count(observed[0]),
                          count(GatherHeldOut(problem, {free, state, observed, {0, 0}})[0]));
  };
  const auto all = observations(two);
  EXPECT_GT(all.second, 5u);
  EXPECT_EQ(observations(without), std::make_pair(all.first, std::size_t{0}));
}

TEST(HeldOutObservations, AreWeighedByTheNoiseThatWasFound) {
  const TwoSensors two;
  const JointProblem problem(two.rig.structure, two.frames, two.options);
  const FreeSet free = AskedFor(ParseEstimate("none"), problem.priors, 2, 4);
  const State state = NominalState(two.rig.structure, {two.frames[0].start, two.frames[1].start});
  const auto covariance = [&](double warp) {
    std::vector<FrameObservations> observed(2);
    for (FrameObservations& of : observed) of.noise.depth.smooth_m = warp;
    const Eigen::MatrixXd root =
        GatherHeldOut(problem, {free, state, observed, {0, 0}})[0].face_root;
    return Eigen::MatrixXd(root * root.transpose());
  };
  // Twice the smooth error is four times its covariance.
  const Eigen::MatrixXd none = covariance(1e-9), some = covariance(0.004),
                        twice = covariance(0.008);
  ASSERT_GT((some - none).trace(), 1e-6);
  EXPECT_TRUE((twice - none).isApprox(4 * (some - none), 1e-6));
}

}  // namespace
}  // namespace volalign::refine_internal::acceptance_test
