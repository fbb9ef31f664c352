#include "infer/refine/bulges.h"

#include <gtest/gtest.h>

#include <vector>

#include "infer/refine/noise.h"
#include "infer/refine/posterior.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::bulges_test {
namespace {

// Two sensors that see a side farther out than it is by one standard deviation: the gradient of the
// cost, which changes by as much against the pull.
TEST(PullsOfBulges, AreWhatSidesThatAreNotFlatDoToTheGradient) {
  const Structure structure = testing_infer::PaperStructure();
  SensorPoints points;
  const std::vector<Pose> poses = {testing_infer::RingPose(35), testing_infer::RingPose(80)};
  std::vector<FrameInput> frames;
  for (const Pose& pose : poses)
    frames.push_back({testing_infer::Borrowed(points), pose, pose, pose});
  RefineOptions options;
  options.bulge_sigma_m = 0.003;
  const JointProblem problem(structure, frames, options);
  Solution solution;
  solution.state = NominalState(structure, poses);
  solution.held = {0, 0};
  for (const Pose& pose : poses) {
    solution.observed.push_back(testing_infer::Observe(structure, pose, 12));
    SetCovariance(problem.model, pose, &solution.observed.back());
  }
  const Eigen::MatrixXd pulls = PullsOfBulges(problem, solution);
  const Eigen::VectorXd gradient = ComputeNormalEquations(problem, solution).gradient;
  ASSERT_EQ(pulls.rows(), gradient.size());
  int seen = 0;
  for (int label = 1; label < structure.num_classes(); ++label) {
    Solution bulging = solution;
    const Side& side = structure.SideOfLabel(label);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      for (FaceObservation& face : bulging.observed[i].faces) {
        if (face.label != label) continue;
        face.p +=
            0.003 * side.BulgeAt(poses[i] * face.p) * poses[i].linear().transpose() * side.normal;
      }
    }
    Eigen::VectorXd change = gradient - ComputeNormalEquations(problem, bulging).gradient;
    change.segment(problem.layout.Considered(0), 2 * kFrameErrors).setZero();
    const Eigen::VectorXd pull = pulls.col(label);
    EXPECT_LT((change - pull).norm(), 0.02 * pull.norm() + 1e-9) << side.name;
    seen += pull.norm() > 0;
  }
  EXPECT_GT(seen, 6);
}

}  // namespace
}  // namespace volalign::refine_internal::bulges_test
