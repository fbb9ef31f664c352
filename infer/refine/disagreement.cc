#include "infer/refine/disagreement.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <utility>

#include "infer/refine/estimates.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

/// A joint solution costs a sensor half a chi-square with as many degrees of freedom as it has
/// unknowns in common with the others, 13 of the paper's structure: 17 in one of a thousand. Noise
/// models are not exact: of rendered sensors that are as they should be, a few reach 30.
constexpr double kMostCost = 40;
constexpr double kPoseSigma = 1;  // m and rad, prior of the pose

}  // namespace

Disagreement MeasureDisagreement(const JointProblem& problem, const Solution& solution,
                                 const FreeSet& asked_for, std::size_t sensor) {
  const SensorEvidence& evidence = solution.evidence[sensor];
  const SensorParameters parameters = solution.state.Parameters(sensor);
  const auto faces = static_cast<Eigen::Index>(evidence.faces.size());
  const auto edges = static_cast<Eigen::Index>(evidence.edges.size());
  if (faces == 0) return {};
  Eigen::VectorXd r;
  Eigen::MatrixXd over_blocks;
  Residuals(problem.model, evidence, parameters, &r, &over_blocks);
  const Eigen::MatrixXd j = SensorColumns::InTangentSpace(over_blocks, parameters.pose);
  Eigen::VectorXd white(r.size());
  Eigen::MatrixXd a(j.rows(), j.cols());
  const auto face_root = evidence.face_root.triangularView<Eigen::Lower>();
  const auto edge_root = evidence.edge_root.triangularView<Eigen::Lower>();
  white << face_root.solve(r.head(faces)), edge_root.solve(r.tail(edges));
  a << face_root.solve(j.topRows(faces)), edge_root.solve(j.bottomRows(edges));

  const auto boxes = static_cast<int>(problem.layout.boxes());
  Eigen::VectorXd precisions(j.cols()), values = Eigen::VectorXd::Zero(j.cols());
  precisions << Eigen::VectorXd::Constant(6, kPoseSigma),
      SharedPriorSigmas(problem.PriorsOf(sensor), evidence.noise.multipath, boxes)
          .unaryExpr(&Positive);
  precisions = precisions.cwiseAbs2().cwiseInverse().eval();
  values.tail(j.cols() - 6) = SharedValues(parameters, boxes);
  // What is not to be estimated stays where it is.
  const ParameterLayout& layout = problem.layout;
  const std::vector<char> constant = layout.Constant(asked_for);
  const auto hold = [&](Eigen::Index first, Eigen::Index column, Eigen::Index count) {
    for (Eigen::Index k = 0; k < count; ++k) {
      if (!constant[static_cast<std::size_t>(first + k)]) continue;
      a.col(column + k).setZero();
      values[column + k] = 0;
    }
  };
  const auto in_tangent = [](Eigen::Index column) { return column - 1; };  // of a pose: 6, not 7
  hold(layout.Offset(sensor), in_tangent(SensorColumns::kOffset), 1);
  hold(layout.Gain(sensor), in_tangent(SensorColumns::kGain), 1);
  hold(layout.Nuisance(sensor, 0), in_tangent(SensorColumns::kNuisance), kNuisances);
  hold(layout.Lens(solution.state.LensOf(sensor)), in_tangent(SensorColumns::kLens),
       kLensParameters);
  hold(layout.Size(), in_tangent(SensorColumns::kSize), 1);
  hold(layout.Boxes(solution.state.StillOf(sensor)), in_tangent(SensorColumns::kBoxes),
       Eigen::Index{3} * boxes);
  Eigen::MatrixXd h = a.transpose() * a;
  h.diagonal() += precisions;
  const Eigen::VectorXd g = a.transpose() * white + precisions.cwiseProduct(values);
  const Eigen::LLT<Eigen::MatrixXd> root(h);
  if (root.info() != Eigen::Success || !g.allFinite()) return {};
  const Eigen::VectorXd step = -root.solve(g);
  const auto rms = [&](const Eigen::VectorXd& of) {
    return std::sqrt(of.head(faces).squaredNorm() / static_cast<double>(faces));
  };
  const Matrix6d covariance =
      root.solve(Eigen::MatrixXd::Identity(h.rows(), h.cols())).topLeftCorner<6, 6>();
  return {-0.5 * g.dot(step), rms(r), rms(r + j * step), covariance};
}

bool Disagrees(const Disagreement& disagreement) { return disagreement.cost > kMostCost; }

Agreed SetAsideDisagreeing(const JointProblem& problem, const FreeSet& asked_for,
                           Solution solution) {
  Agreed agreed{std::move(solution), std::vector<std::optional<SetAside>>(problem.size())};
  if (!asked_for.AllBoxes() || !asked_for.size) return agreed;
  for (std::size_t aside = 0; 2 * (aside + 1) < problem.size(); ++aside) {
    std::optional<std::size_t> worst;
    Disagreement most;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (agreed.solution.kept_initial[i] || !problem.HasStructureTerms(i)) continue;
      const Disagreement of = MeasureDisagreement(problem, agreed.solution, asked_for, i);
      if (!Disagrees(of) || (worst && of.cost <= most.cost)) continue;
      worst = i;
      most = of;
    }
    if (!worst) break;
    Solution without = agreed.solution;
    const Pose together = without.state.poses[*worst].ToPose();
    KeepInitial(problem, *worst, &without);
    without.state.poses[*worst] = PoseBlock(problem.frames[*worst].start);
    without.evidence[*worst] = SensorEvidence();
    without.free = asked_for;
    without.state.scales = PriorScales();
    UpdateLineTolerance(problem, without.state, without.free, &without.evidence);
    std::optional<State> solved = SolveFine(problem, without);
    if (!solved) break;
    without.state = std::move(*solved);
    agreed.solution = ChooseEstimates(problem, std::move(without));
    agreed.of[*worst] = SetAside{together, most};
  }
  return agreed;
}

}  // namespace volalign::refine_internal
