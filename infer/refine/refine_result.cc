#include "infer/refine/refine_result.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "core/base/parallel_for.h"
#include "infer/refine/overlap.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/solution.h"
#include "infer/refine/terms.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

/// A sentence about numbers that failed, or nothing.
std::string Problem(bool unsolved, bool exact_covariance) {
  if (unsolved)
    return "its refinement could not be solved: its measurements give numbers that are not finite";
  if (!exact_covariance)
    return "the uncertainty could not be computed: for quantities that no frame shows, that of the "
           "prior is given";
  return "";
}

/// Covariance of first_from_placement * pose of a frame.
Matrix6d CovarianceInFirst(const JointProblem& problem, const Posterior& posterior,
                           const Pose& placement, std::size_t frame, const Matrix6d& covariance) {
  const Matrix6d turned = Adjoint(placement);
  Matrix6d in_first = turned * covariance * turned.transpose();
  const auto capture = problem.frame_of[frame].capture;
  if (capture == 0) return in_first;
  const Eigen::Index p = problem.layout.Placement(capture), t = problem.layout.Pose(frame);
  const Matrix6d cross = posterior.covariance.block<6, 6>(p, t) * turned.transpose();
  in_first += posterior.covariance.block<6, 6>(p, p) + cross + cross.transpose();
  return (in_first + in_first.transpose()) / 2;
}

RefinedFrame RefinedFrameOf(const Agreed& agreed, std::size_t i) {
  const auto& [free, state, observed, fixed, overlaps] = agreed.solution;
  RefinedFrame frame;
  frame.solved = !fixed[i];
  frame.structure_from_sensor = state.poses[i].ToPose();
  if (free.offset && frame.solved) frame.depth_offset = state.offsets[i];
  if (free.gain && frame.solved) frame.depth_gain = 1 + state.Errors(i)[kGain];
  if (free.lens[state.frame_of[i].lens] && frame.solved) frame.own_focal = state.Errors(i)[kFocal];
  frame.noise = observed[i].noise;
  frame.disagreement = agreed.measured[i].cost;
  if (const std::optional<ExcludedFrame>& excluded = agreed.of[i]) {
    frame.solved = true;
    frame.structure_from_sensor = excluded->alone.poses[i].ToPose();
    frame.depth_offset = excluded->alone.offsets[i];
    frame.depth_gain = 1 + excluded->alone.Errors(i)[kGain];
    frame.own_focal = excluded->alone.Errors(i)[kFocal];
    frame.refused_fit = *excluded;
  }
  frame.first_from_sensor =
      state.placements[state.frame_of[i].capture].ToPose() * frame.structure_from_sensor;
  return frame;
}

void AddUncertainty(const JointProblem& problem, const Agreed& agreed,
                    const std::vector<char>& unsolved, const Posterior& posterior, std::size_t i,
                    RefinedFrame* frame) {
  const ParameterLayout& layout = problem.layout;
  const State& state = agreed.solution.state;
  frame->sigma_depth_offset = posterior.Sigma(layout.Offset(i));
  frame->sigma_depth_gain = posterior.Sigma(layout.Error(i, kGain));
  const Matrix6d block = posterior.covariance.block<6, 6>(layout.Pose(i), layout.Pose(i));
  frame->covariance = (block + block.transpose()) / 2;
  if (agreed.of[i]) frame->covariance = agreed.of[i]->covariance;
  frame->problem = Problem(unsolved[i], posterior.exact);
  frame->first_covariance =
      CovarianceInFirst(problem, posterior, state.placements[state.frame_of[i].capture].ToPose(), i,
                        frame->covariance);
}

std::vector<RefinedBox> BoxResults(const JointProblem& problem, const Agreed& agreed,
                                   std::size_t capture) {
  const std::vector<double>& of_boxes = agreed.solution.state.boxes[capture];
  std::vector<RefinedBox> boxes;
  for (int b = 0; b < static_cast<int>(problem.structure.boxes().size()); ++b) {
    RefinedBox box;
    box.estimated = agreed.solution.free.boxes && IsSeen(problem, agreed.solution, capture, b);
    box.x = of_boxes[static_cast<std::size_t>(BuildModel::X(b))];
    box.z = of_boxes[static_cast<std::size_t>(BuildModel::Z(b))];
    box.yaw = of_boxes[static_cast<std::size_t>(BuildModel::Yaw(b))];
    boxes.push_back(box);
  }
  return boxes;
}

void AddUncertainty(const JointProblem& problem, const Posterior& posterior, std::size_t capture,
                    RefinedPlacement* placement) {
  if (capture > 0) {
    const Eigen::Index column = problem.layout.Placement(capture);
    placement->covariance = posterior.covariance.block<6, 6>(column, column);
  }
  const Eigen::VectorXd sigmas = BoxSigmas(posterior, problem.layout, capture,
                                           GaugeProjection(problem.structure, problem.priors));
  for (std::size_t b = 0; b < placement->boxes.size(); ++b) {
    RefinedBox& box = placement->boxes[b];
    const auto first = static_cast<Eigen::Index>(3 * b);
    box.sigma_x = sigmas[first];
    box.sigma_z = sigmas[first + 1];
    box.sigma_yaw = sigmas[first + 2];
  }
}

/// Columns of one frame's pose, depth offset and depth gain, and of two frames'.
constexpr int kOfFrame = Vector6d::SizeAtCompileTime + 2, kOfPair = 2 * kOfFrame;
using FrameJacobian = Eigen::Matrix<double, kOfFrame, 1>;
using PairMatrix = Eigen::Matrix<double, kOfPair, kOfPair>;

/// Covariance of two frames. Errors of a frame outside of the joint solution are independent of the
/// other's; its pose's covariance includes its depth errors.
PairMatrix CovarianceOfBoth(const JointProblem& problem, const Agreed& agreed,
                            const Posterior& posterior, const std::vector<RefinedFrame>& frames,
                            const std::array<std::size_t, 2>& pair) {
  PairMatrix both = PairMatrix::Zero();
  std::vector<Eigen::Index> columns;
  bool joint = true;
  for (const std::size_t i : pair) {
    joint = joint && !agreed.solution.fixed[i] && !agreed.of[i];
    for (int k = 0; k < 6; ++k) columns.push_back(problem.layout.Pose(i) + k);
    columns.push_back(problem.layout.Offset(i));
    columns.push_back(problem.layout.Error(i, kGain));
  }
  if (joint) both = posterior.covariance(columns, columns);
  both.block<6, 6>(0, 0) = frames[pair[0]].covariance;
  both.block<6, 6>(kOfFrame, kOfFrame) = frames[pair[1]].covariance;
  return both;
}

/// A point of one of two frames at `p`, against a plane with this normal (structure frame).
/// Derivatives of the plane's distance by the frame's pose, depth offset and depth gain; variance
/// of its own error, m^2.
struct PointEnd {
  PointEnd(const OverlapEnd& end, const DepthErrorModel& errors, const Eigen::Vector3d& p,
           const Eigen::Vector3d& normal) {
    const Eigen::Vector3d at = end.state.InStructure(p);
    const double by_depth = normal.dot(end.state.structure_from_sensor.linear() * p) / p.z();
    jacobian << normal, at.cross(normal), by_depth, by_depth * p.z();
    variance = Square(by_depth * errors.White(p.z())) + Square(PointSigma(errors, p));
  }
  FrameJacobian jacobian;
  double variance;
};

/// Sum of RefinedPair::predicted_rms, squared, over the matches of one end's points.
double PredictedSquares(const std::array<OverlapEnd, 2>& ends,
                        const std::array<const DepthErrorModel*, 2>& errors,
                        const PairMatrix& covariance, std::size_t from,
                        const std::vector<Match>& matches) {
  const std::size_t to = 1 - from;
  double squares = 0;
  for (const Match& match : matches) {
    const CloudPoint& on_plane = ends[to].Cloud(match.to);
    const Eigen::Vector3d normal = ends[to].state.structure_from_sensor.linear() * on_plane.normal;
    const PointEnd point(ends[from], *errors[from], ends[from].Cloud(match.from).p, normal);
    const PointEnd plane(ends[to], *errors[to], on_plane.p, normal);
    Eigen::Matrix<double, kOfPair, 1> jacobian;
    jacobian.segment<kOfFrame>(static_cast<Eigen::Index>(kOfFrame * from)) = point.jacobian;
    jacobian.segment<kOfFrame>(static_cast<Eigen::Index>(kOfFrame * to)) = -plane.jacobian;
    squares += point.variance + plane.variance + jacobian.dot(covariance * jacobian);
  }
  return squares;
}

std::vector<RefinedPair> PairResults(const JointProblem& problem, const Agreed& agreed,
                                     const Posterior& posterior,
                                     const std::vector<RefinedFrame>& frames) {
  const State& state = agreed.solution.state;
  std::vector<std::vector<int>> chosen(problem.size());
  ParallelFor(problem.size(), problem.setup.threads, [&](std::size_t i) {
    chosen[i] = ChooseOverlapPoints(state.Built(i), *problem.frames[i].points,
                                    frames[i].structure_from_sensor, kManyProbes, true);
  });
  const auto end = [&](std::size_t i) {
    return OverlapEnd{problem.frames[i].points.get(), &chosen[i], state.Frame(i)};
  };
  std::vector<RefinedPair> pairs;
  for (std::size_t a = 0; a < problem.size(); ++a) {
    for (std::size_t b = a + 1; b < problem.size(); ++b) {
      if (state.frame_of[a].capture == state.frame_of[b].capture)
        pairs.push_back({static_cast<int>(a), static_cast<int>(b)});
    }
  }
  ParallelFor(pairs.size(), problem.setup.threads, [&](std::size_t k) {
    RefinedPair& pair = pairs[k];
    const auto i = static_cast<std::size_t>(pair.a), j = static_cast<std::size_t>(pair.b);
    const PairMatrix both = CovarianceOfBoth(problem, agreed, posterior, frames, {i, j});
    pair.covariance = both.block<6, 6>(0, 0) + both.block<6, 6>(kOfFrame, kOfFrame) -
                      both.block<6, 6>(0, kOfFrame) - both.block<6, 6>(kOfFrame, 0);
    const std::array<OverlapEnd, 2> ends = {end(i), end(j)};
    const SharedPoints shared = FindShared(ends[0], ends[1], kSamePlace, kOnePlane);
    pair.overlap = shared.overlap;
    pair.rms = pair.predicted_rms = std::numeric_limits<double>::quiet_NaN();
    if (!shared.IsPair(problem.setup.min_overlap)) return;
    pair.rms = shared.rms();
    const std::vector<FrameObservations>& observed = agreed.solution.observed;
    const std::array<const DepthErrorModel*, 2> errors = {&observed[i].noise.depth,
                                                          &observed[j].noise.depth};
    const double squares = PredictedSquares(ends, errors, both, 0, shared.of_a) +
                           PredictedSquares(ends, errors, both, 1, shared.of_b);
    pair.predicted_rms =
        std::sqrt(squares / static_cast<double>(shared.of_a.size() + shared.of_b.size()));
  });
  return pairs;
}

std::vector<RefinedQuantity> Quantities(const JointProblem& problem, const Agreed& agreed,
                                        const Posterior& posterior) {
  const ParameterLayout& layout = problem.layout;
  const Eigen::VectorXd values = layout.Values(agreed.solution.state),
                        priors = PriorSigmas(problem, agreed.solution.observed);
  std::vector<RefinedQuantity> quantities;
  const auto add = [&](RefinedQuantity::Kind kind, std::size_t of, Eigen::Index column,
                       double sigma) {
    quantities.push_back({kind, static_cast<int>(of), values[column], priors[column], sigma});
  };
  const auto add_own = [&](RefinedQuantity::Kind kind, std::size_t of, Eigen::Index column) {
    add(kind, of, column, posterior.Sigma(column));
  };
  using Kind = RefinedQuantity::Kind;
  add_own(Kind::kSize, 0, layout.Size());
  // The solution's prior is wide, to find stacks that are measured badly. People's errors are half
  // of it.
  quantities.back().prior_sigma /= 2;
  const Eigen::MatrixXd gauge = GaugeProjection(problem.structure, problem.priors);
  for (std::size_t capture = 0; capture < layout.captures(); ++capture) {
    const Eigen::VectorXd sigmas = BoxSigmas(posterior, layout, capture, gauge);
    for (std::size_t b = 0; b < layout.boxes(); ++b) {
      auto k = static_cast<Eigen::Index>(3 * b);  // x, z and yaw
      for (const Kind kind : {Kind::kBoxX, Kind::kBoxZ, Kind::kBoxYaw}) {
        add(kind, b, layout.Boxes(capture) + k, sigmas[k]);
        ++k;
      }
    }
  }
  std::set<std::size_t> sensors;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (agreed.solution.fixed[i]) continue;
    add_own(Kind::kDepthOffset, i, layout.Offset(i));
    if (sensors.insert(agreed.solution.state.frame_of[i].sensor).second)
      add_own(Kind::kDepthGain, i, layout.Error(i, kGain));
  }
  return quantities;
}

std::vector<RefinedPlacement> PlacementResults(const JointProblem& problem, const Agreed& agreed) {
  const State& state = agreed.solution.state;
  std::vector<RefinedPlacement> placements;
  for (std::size_t capture = 0; capture < problem.layout.captures(); ++capture) {
    RefinedPlacement placement;
    placement.first_from_placement = state.placements[capture].ToPose();
    placement.boxes = BoxResults(problem, agreed, capture);
    placement.built = state.built[capture];
    placements.push_back(std::move(placement));
  }
  return placements;
}

}  // namespace

RefineResult MakeResult(const JointProblem& problem, const Agreed& agreed) {
  const auto& [free, state, observed, fixed, overlaps] = agreed.solution;
  RefineResult result;
  for (std::size_t i = 0; i < problem.size(); ++i)
    result.frames.push_back(RefinedFrameOf(agreed, i));
  result.placements = PlacementResults(problem, agreed);
  result.size_estimated =
      free.size && std::any_of(result.frames.begin(), result.frames.end(),
                               [](const RefinedFrame& frame) { return frame.solved; });
  result.size_scale = 1 + state.size;
  result.structure_from_world = state.world.ToPose();
  result.world_scale = std::exp(state.world_scale);
  result.converged = state.converged;
  for (std::size_t lens = 0; lens < state.lenses.size(); ++lens)
    result.lenses.push_back({state.lenses[lens], free.lens[lens] != 0});
  return result;
}

void AddUncertainties(const JointProblem& problem, const Agreed& agreed,
                      const std::vector<char>& unsolved, const Posterior& posterior,
                      RefineResult* result) {
  for (std::size_t i = 0; i < problem.size(); ++i)
    AddUncertainty(problem, agreed, unsolved, posterior, i, &result->frames[i]);
  for (std::size_t capture = 0; capture < result->placements.size(); ++capture)
    AddUncertainty(problem, posterior, capture, &result->placements[capture]);
  result->sigma_size_scale = posterior.Sigma(problem.layout.Size());
  for (std::size_t lens = 0; lens < result->lenses.size(); ++lens) {
    const Eigen::Index column = problem.layout.Lens(lens);
    result->lenses[lens].sigmas << posterior.Sigma(column), posterior.Sigma(column + 1),
        posterior.Sigma(column + 2);
  }
  result->quantities = Quantities(problem, agreed, posterior);
  result->pairs = PairResults(problem, agreed, posterior, result->frames);
}

}  // namespace volalign::refine_internal
