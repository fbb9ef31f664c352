#include "infer/refine/gauge.h"

#include <vector>

namespace volalign::refine_internal {

namespace {

/// Makes the mean displacement of one capture's boxes zero. Returns the mean.
Eigen::Vector3d TakeMeanOut(std::vector<double>* boxes) {
  // Columns x, z and yaw of each box.
  Eigen::Map<Eigen::Matrix3Xd> all(boxes->data(), 3, static_cast<Eigen::Index>(boxes->size()) / 3);
  const Eigen::Vector2d mean = all.topRows<2>().rowwise().mean();
  all.topRows<2>().colwise() -= mean;
  return {mean.x(), 0, mean.y()};
}

}  // namespace

void CentreBoxes(const JointProblem& problem, Solution* solution) {
  if (!solution->free.boxes) return;
  State* state = &solution->state;
  std::vector<Eigen::Vector3d> means;
  for (std::vector<double>& boxes : state->boxes) means.push_back(TakeMeanOut(&boxes));
  for (std::size_t capture = 1; capture < means.size(); ++capture) {
    Pose placement = state->placements[capture].ToPose();
    placement.translation() += placement.linear() * means[capture] - means[0];
    state->placements[capture] = PoseBlock(placement);
  }
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (solution->fixed[i]) continue;
    Eigen::Map<Eigen::Vector3d>(state->poses[i].values + 4) -= means[state->frame_of[i].capture];
  }
  state->UpdateBuilt(problem.model);
}

}  // namespace volalign::refine_internal
