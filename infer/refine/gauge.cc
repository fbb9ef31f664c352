#include "infer/refine/gauge.h"

#include <algorithm>
#include <vector>

namespace volalign::refine_internal {

namespace {

/// Makes the mean displacement of a still's estimated boxes zero. Returns it.
Eigen::Vector3d TakeMeanOut(const char* estimated, std::vector<double>* boxes) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double count = 0;
  const auto at = [&](int k) -> double& { return (*boxes)[static_cast<std::size_t>(k)]; };
  const int all = static_cast<int>(boxes->size()) / 3;
  for (int b = 0; b < all; ++b) {
    if (!estimated[b]) continue;
    mean += Eigen::Vector3d(at(BuildModel::X(b)), 0, at(BuildModel::Z(b)));
    ++count;
  }
  mean /= std::max(1.0, count);
  for (int b = 0; b < all; ++b) {
    if (!estimated[b]) continue;
    at(BuildModel::X(b)) -= mean.x();
    at(BuildModel::Z(b)) -= mean.z();
  }
  return mean;
}

bool IsHeldByABox(const JointProblem& problem, const Solution& solution, std::size_t still) {
  const char* estimated = solution.free.boxes.data() + still * problem.layout.boxes();
  for (int b = 0; b < static_cast<int>(problem.layout.boxes()); ++b) {
    if (!estimated[b] && IsSeen(problem, solution, still, b)) return true;
  }
  return false;
}

}  // namespace

void CentreBoxes(const JointProblem& problem, Solution* solution) {
  State* state = &solution->state;
  std::vector<Eigen::Vector3d> means;
  for (std::size_t still = 0; still < state->boxes.size(); ++still) {
    if (IsHeldByABox(problem, *solution, still)) {
      means.push_back(Eigen::Vector3d::Zero());
      continue;
    }
    means.push_back(TakeMeanOut(solution->free.boxes.data() + still * problem.layout.boxes(),
                                &state->boxes[still]));
  }
  for (std::size_t still = 1; still < means.size(); ++still) {
    Pose placement = state->placements[still].ToPose();
    placement.translation() += placement.linear() * means[still] - means[0];
    state->placements[still] = PoseBlock(placement);
  }
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (solution->held[i]) continue;
    Eigen::Map<Eigen::Vector3d>(state->poses[i].values + 4) -= means[state->StillOf(i)];
  }
  state->UpdateBuilt(problem.model);
}

}  // namespace volalign::refine_internal
