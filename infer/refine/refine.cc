#include "infer/refine/refine.h"

#include <ceres/version.h>
#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "infer/refine/box_edges.h"
#include "infer/refine/disagreement.h"
#include "infer/refine/posterior.h"
#include "infer/refine/prior_scales.h"
#include "infer/refine/refine_result.h"
#include "infer/refine/solution.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

using namespace refine_internal;  // NOLINT(google-build-using-namespace): its own parts

/// The solution before anything is measured.
Solution Begin(const JointProblem& problem, const std::vector<Pose>& placements,
               const FreeSet& asked_for) {
  std::vector<Pose> starts;
  for (const FrameInput& frame : problem.frames) starts.push_back(frame.start);
  return {asked_for,
          NominalState(problem.structure, starts, problem.lenses, problem.frame_of, placements),
          {},
          std::vector<char>(problem.size(), 0)};
}

void CheckPoses(const std::vector<FrameInput>& frames) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].start.matrix().allFinite()) continue;
    throw DataError(fmt::format("frame {} begins at no finite pose; give one, or leave it out", i));
  }
}

/// Posterior of all parameters under the solution's scales, widened by the uncertainty of the
/// scales.
Posterior PosteriorOf(const JointProblem& problem, const Solution& solution,
                      const FreeSet& asked_for) {
  const QuadraticCost cost = CostAround(problem, solution);
  const Eigen::VectorXd scales = problem.layout.Scales(
      WidenedScales(cost.prior_sigmas, problem.layout, asked_for, solution.state.scales));
  return ComputePosterior(WithScaledPriors(cost, scales), problem.layout.Constant(asked_for),
                          scales.cwiseProduct(cost.prior_sigmas));
}

/// Do the boxes have another size, does a frame contradict the others, or a quantity its prior?
bool IsBuildInDoubt(const RefineResult& result) {
  return std::abs(result.size_scale - 1) > kClearly * result.sigma_size_scale ||
         std::any_of(result.frames.begin(), result.frames.end(),
                     [](const RefinedFrame& frame) { return frame.refused_fit.has_value(); }) ||
         std::any_of(result.quantities.begin(), result.quantities.end(),
                     [](const RefinedQuantity& quantity) { return quantity.Sigmas() > kClearly; });
}

}  // namespace

std::vector<std::string> UnconstrainedDirections(const Matrix6d& covariance) {
  constexpr double kOpenTranslation = kRoughPose, kOpenRotation = 2 * kDegree;
  std::vector<std::string> names;
  for (const bool rotation : {false, true}) {
    const Eigen::Matrix3d part =
        rotation ? covariance.bottomRightCorner<3, 3>() : covariance.topLeftCorner<3, 3>();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(part);
    for (int k = 2; k >= 0; --k) {
      const double sigma = std::sqrt(std::max(solver.eigenvalues()[k], 0.0));
      if (!(sigma > (rotation ? kOpenRotation : kOpenTranslation))) continue;
      Eigen::Vector3d axis = solver.eigenvectors().col(k);
      Eigen::Index main = 0;
      axis.cwiseAbs().maxCoeff(&main);
      if (axis[main] < 0) axis = -axis;
      std::string name = main == 1 ? "the vertical" : main == 0 ? "structure x" : "structure z";
      if (axis[main] < kOnePlane)
        name = fmt::format("structure ({:.2f}, {:.2f}, {:.2f})", axis.x(), axis.y(), axis.z());
      names.push_back(rotation ? fmt::format("about {} ({:.1f} deg)", name, sigma / kDegree)
                               : fmt::format("along {} ({:.2f} m)", name, sigma));
    }
  }
  return names;
}

RefineResult Refine(const Structure& structure, const std::vector<FrameInput>& frames,
                    const RefineSetup& setup, const std::vector<SensorLens>& lenses,
                    const std::vector<Pose>& placements) {
  if (frames.empty()) {
    RefineResult nothing;
    for (const Pose& placement : placements) {
      nothing.placements.push_back({placement, Matrix6d::Zero(),
                                    std::vector<RefinedBox>(structure.boxes().size()), structure});
    }
    for (const SensorLens& lens : lenses) nothing.lenses.push_back({lens.change});
    return nothing;
  }
  CheckPoses(frames);
  const JointProblem problem(structure, frames, setup, lenses, placements.size());
  const FreeSet asked_for = AskedFor(setup.free, problem.priors, frames.size(), problem.lenses);

  Solution solution = Begin(problem, placements, asked_for);
  solution = AssociateAndSolve(problem, std::move(solution));
  const std::vector<char> unsolved = solution.fixed;
  if (setup.free.scale_priors) solution = SolveWithScaledPriors(problem, std::move(solution));
  Agreed agreed{solution, std::vector<std::optional<ExcludedFrame>>(frames.size()),
                std::vector<Disagreement>(frames.size())};
  if (setup.free.scale_priors) agreed = ExcludeDisagreeing(problem, asked_for, solution);
  CentreBoxes(problem, &agreed.solution);
  RefineResult result = MakeResult(problem, agreed);
  if (setup.is_final && !setup.is_final(result)) return result;
  AddUncertainties(problem, agreed, unsolved, PosteriorOf(problem, agreed.solution, asked_for),
                   &result);
  if (setup.free.scale_priors && structure.IsOfBoxes() && IsBuildInDoubt(result))
    result.wrong_edge = LikeliestEdge(problem, solution);
  return result;
}

std::string CeresVersion() { return CERES_VERSION_STRING; }

}  // namespace volalign
