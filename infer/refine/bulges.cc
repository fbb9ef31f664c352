#include "infer/refine/bulges.h"

#include <vector>

#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

Eigen::MatrixXd BulgesOfFaces(const JointProblem& problem, const Solution& solution,
                              std::size_t frame) {
  const Structure& structure = problem.model.structure();
  const std::vector<FaceObservation>& faces = solution.observed[frame].faces;
  const FrameState sensor = solution.state.Frame(frame);
  Eigen::MatrixXd bulges =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(faces.size()), structure.num_classes());
  for (std::size_t k = 0; k < faces.size(); ++k) {
    const double bulge =
        structure.SideOfLabel(faces[k].label).BulgeAt(sensor.InStructure(faces[k].p));
    bulges(static_cast<Eigen::Index>(k), faces[k].label) =
        problem.setup.prior.bulge_sigma_m * bulge;
  }
  return bulges;
}

Eigen::MatrixXd PullsOfBulges(const JointProblem& problem, const Solution& solution) {
  const ParameterLayout& layout = problem.layout;
  const auto boxes = Eigen::Index{3} * static_cast<Eigen::Index>(layout.boxes());
  Eigen::MatrixXd pulls =
      Eigen::MatrixXd::Zero(layout.size(), problem.model.structure().num_classes());
  for (std::size_t i = 0; i < problem.size(); ++i) {
    const FrameObservations& observed = solution.observed[i];
    if (!problem.HasStructureTerms(i) || solution.held[i] || observed.faces.empty()) continue;
    const auto faces = static_cast<Eigen::Index>(observed.faces.size());
    const FrameParameters parameters = solution.state.Parameters(i);
    Eigen::VectorXd r;
    Eigen::MatrixXd over_blocks;
    Residuals(problem.model, observed, parameters, &r, &over_blocks);
    const Eigen::MatrixXd j =
        FrameColumns::InTangentSpace(over_blocks, parameters.pose).topRows(faces);
    const auto root = observed.face_root.triangularView<Eigen::Lower>();
    const Eigen::MatrixXd pull =
        -root.solve(j).transpose() * root.solve(BulgesOfFaces(problem, solution, i));
    const auto add = [&](Eigen::Index to, Eigen::Index column, Eigen::Index count) {
      pulls.middleRows(to, count) += pull.middleRows(column - 1, count);  // a pose has 6, not 7
    };
    pulls.middleRows<6>(layout.Pose(i)) += pull.topRows<6>();
    add(layout.Offset(i), FrameColumns::kOffset, 1);
    add(layout.Gain(i), FrameColumns::kGain, 1);
    add(layout.Focal(i), FrameColumns::kFocal, 1);
    add(layout.Nuisance(i, 0), FrameColumns::kNuisance, kNuisances);
    add(layout.Lens(solution.state.LensOf(i)), FrameColumns::kLens, kLensParameters);
    add(layout.Size(), FrameColumns::kSize, 1);
    add(layout.Boxes(solution.state.StillOf(i)), FrameColumns::kBoxes, boxes);
  }
  return pulls;
}

}  // namespace volalign::refine_internal
