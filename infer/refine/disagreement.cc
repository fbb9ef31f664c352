#include "infer/refine/disagreement.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "core/base/parallel_for.h"
#include "core/geometry/factor.h"
#include "infer/refine/prior_scales.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

/// How often as much as chance makes it in one of a thousand a disagreement may cost. Noise models
/// are not exact: of rendered sensors that are as they should be, a few reach 1.7 times as much. A
/// focal length that is 6 % off makes 2.2 to 3.2 times as much (the test Disagrees).
constexpr double kMostOften = 2;
/// m: where measurements lie so much farther off than by themselves, chance is enough.
constexpr double kMostRise = 0.0015;
constexpr double kShownBy = 0.5;  // share of the largest contradiction

/// What a frame's own measurements say, linearised about a solution: 0.5 |r + j s|^2 in standard
/// deviations, s the step of its parameters in the order of FrameColumns, but with 6 of the pose.
struct OwnMeasurements {
  Eigen::MatrixXd j;  // columns of what is held are zero
  Eigen::VectorXd r;
  Eigen::VectorXd precisions;  // of the priors
  Eigen::VectorXd values;      // by which parameters differ from the priors' means; 0 of the held
  Eigen::VectorXd faces;       // residuals of faces, m
  Eigen::MatrixXd by_faces;    // their derivatives
  /// Times residuals of faces: of these, what bulges of sides do not explain.
  Eigen::MatrixXd unexplained;
};

/// Columns of what the frames of a still have in common: the size and the boxes.
constexpr Eigen::Index kShared = FrameColumns::kSize - 1;

OwnMeasurements Linearise(const JointProblem& problem, const Solution& solution,
                          const FreeSet& asked_for, std::size_t frame) {
  const FrameObservations& observed = solution.observed[frame];
  FrameParameters parameters = solution.state.Parameters(frame);
  const BuildSize build = problem.model.size();
  const std::vector<double> flat(static_cast<std::size_t>(build.sides), 0);
  parameters.build.bulges = flat.data();
  const auto faces = static_cast<Eigen::Index>(observed.faces.size());
  const auto edges = static_cast<Eigen::Index>(observed.edges.size());
  Eigen::VectorXd r;
  Eigen::MatrixXd over_blocks;
  Residuals(problem.model, observed, parameters, &r, &over_blocks);
  const Eigen::MatrixXd j = FrameColumns::InTangentSpace(over_blocks, parameters.pose);
  OwnMeasurements own;
  own.faces = r.head(faces);
  own.by_faces = j.topRows(faces);
  own.r.resize(r.size());
  own.j.resize(j.rows(), j.cols());
  const Eigen::MatrixXd errors = problem.priors.bulge * own.by_faces.rightCols(build.sides);
  const Eigen::MatrixXd random = observed.face_root * observed.face_root.transpose();
  const std::optional<CholeskyFactor> factor = Factor(random + errors * errors.transpose());
  const Eigen::MatrixXd face_lower = factor ? Eigen::MatrixXd(factor->matrixL())
                                            : Eigen::MatrixXd::Constant(faces, faces, std::nan(""));
  if (factor) own.unexplained = factor->solve(random).transpose();
  const auto face_root = face_lower.triangularView<Eigen::Lower>();
  const auto edge_root = observed.edge_root.triangularView<Eigen::Lower>();
  own.r << face_root.solve(r.head(faces)), edge_root.solve(r.tail(edges));
  own.j << face_root.solve(j.topRows(faces)), edge_root.solve(j.bottomRows(edges));

  own.precisions.resize(j.cols());
  own.precisions << Eigen::VectorXd::Constant(6, kPoseSigma),
      SharedPriorSigmas(problem.PriorsOf(frame), observed.noise.depth, build).unaryExpr(&Positive);
  own.precisions = own.precisions.cwiseAbs2().cwiseInverse().eval();
  own.values = Eigen::VectorXd::Zero(j.cols());
  own.values.tail(j.cols() - 6) = SharedValues(parameters, build);

  // What is not to be estimated stays where it is.
  const ParameterLayout& layout = problem.layout;
  const std::vector<char> constant = layout.Constant(asked_for);
  const auto hold = [&](Eigen::Index first, Eigen::Index column, Eigen::Index count) {
    for (Eigen::Index k = 0; k < count; ++k) {
      if (!constant[static_cast<std::size_t>(first + k)]) continue;
      own.j.col(column + k).setZero();
      own.values[column + k] = 0;
    }
  };
  const auto in_tangent = [](Eigen::Index column) { return column - 1; };  // of a pose: 6, not 7
  hold(layout.Offset(frame), in_tangent(FrameColumns::kOffset), 1);
  hold(layout.Gain(frame), in_tangent(FrameColumns::kGain), 1);
  hold(layout.Focal(frame), in_tangent(FrameColumns::kFocal), 1);
  hold(layout.Nuisance(frame, 0), in_tangent(FrameColumns::kNuisance), kNuisances);
  hold(layout.Lens(solution.state.LensOf(frame)), in_tangent(FrameColumns::kLens), kLensParameters);
  hold(layout.Size(), kShared, 1);
  hold(layout.Boxes(solution.state.StillOf(frame)), in_tangent(FrameColumns::kBoxes),
       Eigen::Index{3} * build.boxes);
  own.j.rightCols(build.sides).setZero();
  return own;
}

bool HasFaces(const Solution& solution, std::size_t frame) {
  return !solution.observed[frame].faces.empty();
}

/// 0.5 s' information s + gradient' s, of what frames share, all else being at its best.
struct SharedCost {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;

  /// With the priors: the least of it, below its value at the solution. Nothing where there is
  /// none.
  std::optional<double> Gain(const Eigen::VectorXd& precisions,
                             const Eigen::VectorXd& values) const {
    Eigen::MatrixXd h = information;
    h.diagonal() += precisions;
    const Eigen::VectorXd g = gradient + precisions.cwiseProduct(values);
    const std::optional<CholeskyFactor> factor = Factor(h);
    if (!factor || !g.allFinite()) return std::nullopt;
    return 0.5 * g.dot(factor->solve(g));
  }
};
std::optional<SharedCost> CostOfShared(const OwnMeasurements& own) {
  const Eigen::MatrixXd h = own.j.transpose() * own.j;
  const Eigen::VectorXd g = own.j.transpose() * own.r;
  Eigen::MatrixXd inner = h.topLeftCorner(kShared, kShared);
  inner.diagonal() += own.precisions.head(kShared);
  const Eigen::VectorXd inner_g =
      g.head(kShared) + own.precisions.head(kShared).cwiseProduct(own.values.head(kShared));
  const Eigen::Index shared = h.rows() - kShared;
  const Eigen::MatrixXd cross = h.topRightCorner(kShared, shared);
  const std::optional<CholeskyFactor> factor = Factor(inner);
  if (!factor) return std::nullopt;
  return SharedCost{h.bottomRightCorner(shared, shared) - cross.transpose() * factor->solve(cross),
                    g.tail(shared) - cross.transpose() * factor->solve(inner_g)};
}

}  // namespace

Disagreement MeasureDisagreement(const JointProblem& problem, const Solution& solution,
                                 const FreeSet& asked_for, std::size_t frame) {
  if (!HasFaces(solution, frame)) return {};
  const OwnMeasurements own = Linearise(problem, solution, asked_for, frame);
  Eigen::MatrixXd h = own.j.transpose() * own.j;
  h.diagonal() += own.precisions;
  const Eigen::VectorXd g = own.j.transpose() * own.r + own.precisions.cwiseProduct(own.values);
  const std::optional<CholeskyFactor> factor = Factor(h);
  if (!factor || !g.allFinite()) return {};
  const Eigen::VectorXd step = -factor->solve(g);
  const auto rms = [](const Eigen::VectorXd& of) {
    return std::sqrt(of.squaredNorm() / static_cast<double>(of.size()));
  };
  const Matrix6d covariance =
      factor->solve(Eigen::MatrixXd::Identity(h.rows(), h.cols())).topLeftCorner<6, 6>();
  return {-0.5 * g.dot(step), rms(own.unexplained * own.faces),
          rms(own.unexplained * (own.faces + own.by_faces * step)), covariance};
}

double MeasureContradiction(const JointProblem& problem, const Solution& solution,
                            const FreeSet& asked_for, std::size_t a, std::size_t b) {
  if (!HasFaces(solution, a) || !HasFaces(solution, b)) return 0;
  const OwnMeasurements of_a = Linearise(problem, solution, asked_for, a);
  const std::optional<SharedCost> cost_a = CostOfShared(of_a);
  const std::optional<SharedCost> cost_b = CostOfShared(Linearise(problem, solution, asked_for, b));
  if (!cost_a || !cost_b) return 0;
  const Eigen::Index shared = cost_a->gradient.size();
  const Eigen::VectorXd precisions = of_a.precisions.tail(shared);
  const Eigen::VectorXd values = of_a.values.tail(shared);
  const SharedCost both{cost_a->information + cost_b->information,
                        cost_a->gradient + cost_b->gradient};
  const SharedCost none{Eigen::MatrixXd::Zero(shared, shared), Eigen::VectorXd::Zero(shared)};
  double cost = 0;
  for (const auto& [of, sign] : {std::pair(&*cost_a, 1), std::pair(&*cost_b, 1),
                                 std::pair(&both, -1), std::pair(&none, -1)}) {
    const std::optional<double> gain = of->Gain(precisions, values);
    if (!gain) return 0;
    cost += sign * *gain;
  }
  return cost;
}

double UnlikelyCost(std::size_t unknowns) {
  constexpr double kNormal = 3.0902;  // of a standard normal variable, in one of a thousand
  const double spread = 2 / (9 * static_cast<double>(unknowns));
  return 0.5 * static_cast<double>(unknowns) *
         std::pow(1 - spread + kNormal * std::sqrt(spread), 3);
}

bool Disagrees(const Disagreement& disagreement, std::size_t unknowns) {
  if (unknowns == 0) return false;
  const double unlikely = UnlikelyCost(unknowns);
  const double rise = disagreement.rms_together - disagreement.rms_alone;
  return disagreement.cost > (rise > kMostRise ? unlikely : kMostOften * unlikely);
}

namespace {

/// `free`, and of the build whatever its priors leave open.
FreeSet WithBuild(const JointProblem& problem, FreeSet free) {
  free.boxes = problem.priors.box > 0;
  free.size = problem.priors.size > 0;
  return free;
}

/// What frames of one still have in common: three of each box, and the size.
std::size_t CountShared(const JointProblem& problem, const FreeSet& free) {
  return (free.boxes ? 3 * problem.layout.boxes() : 0) + (free.size ? 1 : 0);
}

/// The frames of its still that a frame contradicts at least half as much as the one that it
/// contradicts most.
std::vector<int> FindContradicted(const JointProblem& problem, const Solution& solution,
                                  const FreeSet& asked_for, std::size_t frame) {
  std::vector<std::pair<double, int>> others;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (i == frame || solution.held[i] ||
        problem.frame_of[i].still != problem.frame_of[frame].still)
      continue;
    const double cost = MeasureContradiction(problem, solution, asked_for, frame, i);
    others.emplace_back(-cost, static_cast<int>(i));
  }
  std::sort(others.begin(), others.end());
  std::vector<int> contradicted;
  for (const auto& [cost, i] : others) {
    if (cost < kShownBy * others.front().first) contradicted.push_back(i);
  }
  return contradicted;
}

/// Of a frame that disagrees: the one to set aside. That a sensor has moved pulls on all its
/// frames. Of three or more it is the one that begins farthest from the others.
std::size_t FindOddOne(const JointProblem& problem, const Agreed& agreed, std::size_t unknowns,
                       std::size_t worst) {
  const State& state = agreed.solution.state;
  std::vector<std::size_t> frames;
  std::vector<Eigen::Vector3d> places;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (state.SensorOf(i) != state.SensorOf(worst) || agreed.solution.held[i]) continue;
    frames.push_back(i);
    places.push_back(state.placements[state.StillOf(i)].ToPose() *
                     problem.frames[i].start.translation());
  }
  if (frames.size() < 3) return worst;
  double farthest = 0;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (!Disagrees(agreed.measured[frames[k]], unknowns)) continue;
    double sum = 0;
    for (const Eigen::Vector3d& other : places) sum += (other - places[k]).norm();
    if (sum <= farthest) continue;
    farthest = sum;
    worst = frames[k];
  }
  return worst;
}

/// May this frame be set aside, too? Where its sensor has three frames or more, most of these have
/// to stay; else most sensors have to be without a frame that is set aside.
bool LeavesMajority(const JointProblem& problem, const Agreed& agreed,
                    const std::vector<char>& takes_part, std::size_t frame) {
  std::map<int, std::pair<int, int>> of_sensor;  // its frames, and those set aside
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!takes_part[i]) continue;
    auto& [frames, aside] = of_sensor[agreed.solution.state.SensorOf(i)];
    ++frames;
    aside += agreed.of[i] || i == frame ? 1 : 0;
  }
  const auto& [frames, aside] = of_sensor[agreed.solution.state.SensorOf(frame)];
  if (frames >= 3 && 2 * aside < frames) return true;
  const auto doubted = std::count_if(of_sensor.begin(), of_sensor.end(),
                                     [](const auto& sensor) { return sensor.second.second > 0; });
  return 2 * static_cast<std::size_t>(doubted) < of_sensor.size();
}

/// What a frame's own measurements and the priors make most probable, the lens being known. It
/// begins at the frame's start: others may have pulled it out of reach of what it measured.
std::optional<State> SolveAlone(const JointProblem& problem, const FreeSet& asked_for,
                                std::size_t frame, Solution solution) {
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (i != frame) HoldFrame(problem, i, &solution);
  }
  solution.state.poses[frame] = PoseBlock(problem.frames[frame].start);
  solution.free = asked_for;
  std::fill(solution.free.lens.begin(), solution.free.lens.end(), 0);
  solution.state.scales = kWholePriors;
  Solution alone = AssociateAndSolve(problem, std::move(solution));
  if (alone.held[frame]) return std::nullopt;
  return std::move(alone.state);
}

/// From whole priors on.
std::optional<Solution> SolveAnew(const JointProblem& problem, const FreeSet& asked_for,
                                  Solution solution) {
  solution.free = asked_for;
  solution.state.scales = kWholePriors;
  SetLineTolerance(problem, LineTolerance(asked_for), &solution);
  if (!Solve(problem, &solution)) return std::nullopt;
  return SolveWithScaledPriors(problem, std::move(solution));
}

/// What is left when a frame stays at a pose and says nothing.
std::optional<Solution> SolveWithout(const JointProblem& problem, const FreeSet& asked_for,
                                     std::size_t frame, const PoseBlock& pose, Solution solution) {
  HoldFrame(problem, frame, &solution);
  solution.state.poses[frame] = pose;
  solution.observed[frame].Forget();
  return SolveAnew(problem, asked_for, std::move(solution));
}

/// See SetAsideDisagreeing; of a solution in which all of `asked_for` may be free.
Agreed SetAsideOneByOne(const JointProblem& problem, const FreeSet& asked_for, Solution solution) {
  const std::size_t unknowns = CountShared(problem, asked_for);
  Agreed agreed{std::move(solution), std::vector<std::optional<SetAside>>(problem.size()),
                std::vector<Disagreement>(problem.size())};
  std::vector<char> takes_part, settled(problem.size(), 0);  // settled: cannot be solved alone
  for (const char held : agreed.solution.held) takes_part.push_back(held ? 0 : 1);
  for (;;) {
    std::optional<std::size_t> worst;
    ParallelFor(problem.size(), problem.setup.schedule.threads, [&](std::size_t i) {
      if (!agreed.solution.held[i])
        agreed.measured[i] = MeasureDisagreement(problem, agreed.solution, asked_for, i);
    });
    for (std::size_t i = 0; i < problem.size(); ++i) {
      if (agreed.solution.held[i] || settled[i] ||
          !problem.frames[i].aside.value_or(Disagrees(agreed.measured[i], unknowns)))
        continue;
      if (!worst || agreed.measured[i].cost > agreed.measured[*worst].cost) worst = i;
    }
    if (!worst) break;
    if (!problem.frames[*worst].aside) {
      const std::size_t odd = FindOddOne(problem, agreed, unknowns, *worst);
      if (!settled[odd]) worst = odd;
    }
    if (!LeavesMajority(problem, agreed, takes_part, *worst)) break;
    std::optional<State> alone = SolveAlone(problem, asked_for, *worst, agreed.solution);
    std::optional<Solution> without =
        alone ? SolveWithout(problem, asked_for, *worst, alone->poses[*worst], agreed.solution)
              : std::nullopt;
    if (!without) {
      settled[*worst] = 1;
      continue;
    }
    agreed.of[*worst] =
        SetAside{agreed.solution.state.poses[*worst].ToPose(),
                 FindContradicted(problem, agreed.solution, asked_for, *worst), std::move(*alone)};
    agreed.solution = std::move(*without);
  }
  return agreed;
}

}  // namespace

Agreed SetAsideDisagreeing(const JointProblem& problem, const FreeSet& asked_for,
                           Solution solution) {
  const FreeSet tested = WithBuild(problem, asked_for);
  if (tested.boxes == asked_for.boxes && tested.size == asked_for.size)
    return SetAsideOneByOne(problem, asked_for, std::move(solution));
  std::optional<Solution> freed = SolveAnew(problem, tested, solution);
  if (!freed) return SetAsideOneByOne(problem, asked_for, std::move(solution));
  Agreed agreed = SetAsideOneByOne(problem, tested, std::move(*freed));
  for (std::size_t i = 0; i < problem.size(); ++i) {
    if (!agreed.of[i]) continue;
    std::optional<Solution> without =
        SolveWithout(problem, asked_for, i, agreed.of[i]->alone.poses[i], solution);
    if (without) {
      solution = std::move(*without);
    } else {
      agreed.of[i].reset();
    }
  }
  agreed.solution = std::move(solution);
  return agreed;
}

}  // namespace volalign::refine_internal
