#include "infer/refine/refine.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <set>
#include <utility>

#include "core/error.h"
#include "core/parallel_for.h"
#include "core/visibility.h"
#include "infer/refine/costs.h"
#include "infer/refine/model.h"

namespace volalign {

namespace {

using refine_internal::BuildModel;
using refine_internal::EdgeObservation;
using refine_internal::FaceObservation;
using refine_internal::FitNoise;
using refine_internal::kEdgeShift;
using refine_internal::kMultipath;
using refine_internal::kNuisances;
using refine_internal::kDepthGain;
using refine_internal::LeftPoseManifold;
using refine_internal::LineCost;
using refine_internal::OverlapCost;
using refine_internal::PoseBlock;
using refine_internal::PosePriorCost;
using refine_internal::PriorCost;
using refine_internal::Priors;
using refine_internal::SeamShare;
using refine_internal::SensorCost;
using refine_internal::SensorEvidence;
using refine_internal::SensorParameters;
using refine_internal::SideCost;

constexpr double kFaceScale = 0.01;  // m, of the cost that accepts a sensor without structure
/// m: how far a real box's edges stray from where the structure has them, beyond what its faces do.
/// On the three real captures it was 10-30 mm for faces that fit to 4 mm: boxes are placed by hand,
/// cardboard bulges, and sensors fatten edges.
constexpr double kEdgeTolerance = 0.008;
/// m: the same in the last stage, which knows that faces stray as well, where boxes are not
/// estimated.
constexpr double kHeldEdge = 0.012;
constexpr double kMinResidualSigma = 5e-4;  // m: below it the depth's own resolution counts
/// A parameter is observable when its posterior standard deviation is below this share of the
/// prior's.
constexpr double kObservable = 0.7;
/// px, standard deviation of the shift of silhouettes that all sensors have in common.
constexpr double kCommonEdgeShift = 0.3;
/// Overlap off the structure, in the last stage: gate in m; share of its distance from the optical
/// axis by which a point is off for the intrinsics' errors, which the structure, in the middle of
/// the frame, hardly shows.
constexpr double kFineOverlapGate = 0.06, kIntrinsicsError = 0.002;
/// m: nearer to the structure than this, overlap says what the structure's own terms say already.
constexpr double kOffStructure = 0.05;

/// Gates and scales of one association, coarse to fine.
struct Stage {
  double side_gate;     // m, distance of a labelled point to its side
  double overlap_gate;  // m, distance of matched points
  double min_cosine;    // between matched normals
  double scale;         // m, least standard deviation that residuals are whitened with
};

Stage StageOf(int iteration) {
  const double shrink = std::pow(0.6, iteration);
  return {std::max(0.15 * shrink, 0.06), std::max(0.12 * shrink, 0.02),
          std::cos(std::max(45.0 * shrink, 20.0) * M_PI / 180), 0.03 * std::pow(0.5, iteration)};
}

double RobustCost(double distance, double scale) {
  const double x = std::min(std::abs(distance), 0.1) / scale;
  return std::log1p(x * x);
}

/// One of the four edge lines of a side: direction . p = offset, direction pointing out of the
/// side.
struct EdgeLine {
  Eigen::Vector3d direction;
  double offset;
  int edge;  ///< 0 ... 3: +u, -u, +v, -v
};

/// The edge of the side that a silhouette point belongs to: the nearest whose direction agrees with
/// `outward`.
bool NearestEdge(const Side& side, const Eigen::Vector3d& p, const Eigen::Vector3d& outward,
                 double gate, EdgeLine* line) {
  double best = gate;
  bool found = false;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector3d direction = (i % 2 ? -1.0 : 1.0) * (i < 2 ? side.axis_u : side.axis_v);
    if (direction.dot(outward) < 0.6) continue;
    const double offset = direction.dot(side.centre) + (i < 2 ? side.half_u : side.half_v);
    const double distance = std::abs(direction.dot(p) - offset);
    if (distance < best) {
      best = distance;
      *line = {direction, offset, i};
      found = true;
    }
  }
  return found;
}

double MedianOf(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class JointProblem {
 public:
  JointProblem(const Structure& structure, const std::vector<RefineSensor>& sensors,
               const RefineOptions& options)
      : structure_(structure),
        sensors_(sensors),
        options_(options),
        wanted_(ParseEstimate(options.estimate)),
        model_(structure_),
        built_(structure),
        sigma_(sensors.size(), 0.005),
        fixed_(sensors.size(), 0),
        evidence_(sensors.size()),
        unseen_(sensors.size()) {
    for (const RefineSensor& sensor : sensors) state_.poses.emplace_back(sensor.start);
    state_.offsets.assign(sensors.size(), 0);
    state_.nuisances.assign(sensors.size(), {});
    state_.build.assign(static_cast<std::size_t>(model_.size()), 0);
    priors_.offset = options.depth_offset_sigma_m;
    priors_.gain = options.depth_gain_sigma_percent / 100;
    priors_.edge_shift = options.edge_shift_sigma_px;
    priors_.size = options.size_sigma_percent / 100;
    priors_.box = options.box_sigma_m;
    priors_.yaw = options.box_sigma_deg * M_PI / 180;
    ChooseOverlapPoints();
  }

  RefineResult Run() {
    for (int iteration = 0; options_.coarse && iteration < options_.outer_iterations; ++iteration)
      SolveCoarse(StageOf(iteration));
    free_.boxes.assign(structure_.boxes().size(), wanted_.boxes && priors_.box > 0);
    free_.size = wanted_.size && priors_.size > 0;
    free_.gain.assign(sensors_.size(), wanted_.depth_gain && priors_.gain > 0);
    free_.offset.assign(sensors_.size(), wanted_.depth_offset && priors_.offset > 0);
    asked_ = free_;
    for (int iteration = 0; iteration < options_.fine_iterations; ++iteration) {
      CollectEvidence();
      SolveFine();
    }
    if (options_.choose_estimates) KeepWhatTheCaptureTells();
    CollectUnseen();
    std::vector<HeldOut> before(sensors_.size());
    std::vector<Vector6d> refused(sensors_.size(), Vector6d::Zero());
    // A sensor that goes back may have pulled its neighbours: they are solved again around it.
    for (std::size_t round = 0; round < sensors_.size(); ++round) {
      bool changed = false;
      for (std::size_t i = 0; i < sensors_.size(); ++i) {
        if (fixed_[i]) continue;
        before[i] = ComputeHeldOut(i, sensors_[i].initial);
        const HeldOut after = ComputeHeldOut(i, state_.poses[i].ToPose());
        if (after.misfit < before[i].misfit || after.distance < before[i].distance) continue;
        const Pose apart = state_.poses[i].ToPose() * sensors_[i].initial.inverse();
        refused[i] << apart.translation(), RotationLog(apart.linear());
        state_.poses[i] = PoseBlock(sensors_[i].initial);
        state_.offsets[i] = 0;
        state_.nuisances[i] = {};
        fixed_[i] = 1;
        changed = true;
      }
      if (!changed) break;
      SolveFine();
    }

    RefineResult result;
    CentreBoxes();
    const Posterior posterior = ComputePosterior(ComputeNormal());
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      RefinedSensor sensor;
      sensor.accepted = !fixed_[i];
      sensor.structure_from_sensor = fixed_[i] ? sensors_[i].initial : state_.poses[i].ToPose();
      if (free_.offset[i] && !fixed_[i]) sensor.depth_offset = state_.offsets[i];
      if (free_.gain[i] && !fixed_[i]) sensor.depth_gain = 1 + state_.nuisances[i][kDepthGain];
      sensor.sigma_depth_offset = posterior.Sigma(OffsetColumn(i));
      sensor.sigma_depth_gain = posterior.Sigma(NuisanceColumn(i) + kDepthGain);
      sensor.held_out_before = before[i].misfit;
      sensor.held_out_after =
          fixed_[i] ? before[i].misfit : ComputeHeldOut(i, sensor.structure_from_sensor).misfit;
      const auto first = static_cast<Eigen::Index>(6 * i);
      const Matrix6d block = posterior.covariance.block<6, 6>(first, first);
      sensor.covariance = (block + block.transpose()) / 2 + refused[i] * refused[i].transpose();
      result.sensors.push_back(sensor);
    }
    const Eigen::VectorXd sigmas = BoxSigmas(posterior);
    for (std::size_t b = 0; b < structure_.boxes().size(); ++b) {
      const int box = static_cast<int>(b);
      RefinedBox out;
      out.estimated = free_.boxes[b] && Sees(box);
      out.x = state_.build[static_cast<std::size_t>(BuildModel::X(box))];
      out.z = state_.build[static_cast<std::size_t>(BuildModel::Z(box))];
      out.yaw = state_.build[static_cast<std::size_t>(BuildModel::Yaw(box))];
      out.sigma_x = sigmas[3 * box];
      out.sigma_z = sigmas[3 * box + 1];
      out.sigma_yaw = sigmas[3 * box + 2];
      result.boxes.push_back(out);
    }
    result.size_estimated =
        free_.size && std::any_of(result.sensors.begin(), result.sensors.end(),
                                  [](const RefinedSensor& sensor) { return sensor.accepted; });
    result.size_scale = 1 + state_.build[0];
    result.sigma_size_scale = posterior.Sigma(BuildColumn());
    result.built = built_;
    result.pairs = Pairs();
    return result;
  }

 private:
  struct Match {
    int from, to;     // indices into the clouds of a and b
    double residual;  // m
  };
  /// All parameters.
  struct State {
    std::vector<PoseBlock> poses;
    std::vector<double> offsets;                            // m, of each sensor's depth
    std::vector<std::array<double, kNuisances>> nuisances;  // see SensorParameters
    std::vector<double> build;                              // see BuildModel
  };
  /// What is estimated beside the poses and the nuisances that are always free.
  struct Free {
    std::vector<char> boxes, gain, offset;
    bool size = false;
  };
  struct Normal {
    Eigen::MatrixXd information;
    Eigen::VectorXd gradient;
  };
  struct Posterior {
    Eigen::MatrixXd covariance;  // of all parameters, poses first
    double Sigma(Eigen::Index i) const { return std::sqrt(std::max(covariance(i, i), 0.0)); }
  };

  Eigen::Vector3d Corrected(std::size_t i, const Eigen::Vector3d& p) const {
    return Corrected(state_, i, p);
  }
  static Eigen::Vector3d Corrected(const State& state, std::size_t i, const Eigen::Vector3d& p) {
    return p * (1 + state.nuisances[i][kDepthGain] + state.offsets[i] / p.z());
  }
  bool Holds(std::size_t i) const { return sensors_[i].use_structure_terms; }

  // Columns of the Jacobian with everything free.
  Eigen::Index OffsetColumn(std::size_t i) const {
    return static_cast<Eigen::Index>(6 * sensors_.size() + i);
  }
  Eigen::Index NuisanceColumn(std::size_t i) const {
    return static_cast<Eigen::Index>(7 * sensors_.size() + kNuisances * i);
  }
  Eigen::Index BuildColumn() const {
    return static_cast<Eigen::Index>((7 + kNuisances) * sensors_.size());
  }

  /// Cloud points that are offered to other sensors: mostly those around the structure, the rest
  /// from farther away.
  void ChooseOverlapPoints() {
    overlap_points_.resize(sensors_.size());
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
    for (const Side& side : structure_.sides()) {
      const Eigen::Vector3d reach =
          side.half_u * side.axis_u.cwiseAbs() + side.half_v * side.axis_v.cwiseAbs();
      low = low.cwiseMin(side.centre - reach);
      high = high.cwiseMax(side.centre + reach);
    }
    constexpr double kAround = 0.3;
    low.array() -= kAround;
    high.array() += kAround;
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      std::vector<int> near, far;
      const std::vector<CloudPoint>& cloud = sensors_[i].view->cloud;
      for (std::size_t j = 0; j < cloud.size(); ++j) {
        const Eigen::Vector3d p = sensors_[i].start * cloud[j].p;
        const bool inside = (p.array() >= low.array()).all() && (p.array() <= high.array()).all();
        (inside ? near : far).push_back(static_cast<int>(j));
      }
      const auto most = static_cast<std::size_t>(options_.max_overlap_points);
      const auto take = [&](const std::vector<int>& from, std::size_t count) {
        count = std::min(count, from.size());
        for (std::size_t j = 0; j < count; ++j) {
          overlap_points_[i].push_back(from[j * from.size() / count]);
        }
      };
      take(near, most * 7 / 10);
      take(far, most - overlap_points_[i].size());
    }
  }

  std::vector<Match> FindMatches(std::size_t a, std::size_t b, double gate,
                                 double min_cosine) const {
    const Pose b_from_a = state_.poses[b].ToPose().inverse() * state_.poses[a].ToPose();
    std::vector<Match> matches;
    for (const int i : overlap_points_[a]) {
      const CloudPoint& from = sensors_[a].view->cloud[static_cast<std::size_t>(i)];
      const Eigen::Vector3d p = b_from_a * Corrected(a, from.p);
      if (p.z() <= 0) continue;
      const int j = sensors_[b].view->Nearest(p, gate);
      if (j < 0) continue;
      const CloudPoint& to = sensors_[b].view->cloud[static_cast<std::size_t>(j)];
      if ((b_from_a.linear() * from.normal).dot(to.normal) < min_cosine) continue;
      matches.push_back({i, j, to.normal.dot(p - Corrected(b, to.p))});
    }
    return matches;
  }

  void AddStructureTerms(std::size_t i, const Stage& stage, double edge_information,
                         ceres::Problem* problem) {
    const Pose pose = state_.poses[i].ToPose();
    const double sigma = std::max(sigma_[i], stage.scale);
    for (const SidePoint& point : sensors_[i].view->side_points) {
      if (point.held_out || !OnItsSide(i, point, pose, stage)) continue;
      problem->AddResidualBlock(
          new SideCost(point.p, structure_.SideOfLabel(point.label), 1 / sigma), loss_.get(),
          state_.poses[i].values, &state_.offsets[i]);
    }
    const double edge_weight = std::sqrt(edge_information);
    for (const EdgePoint& edge : sensors_[i].view->edge_points) {
      EdgeLine line;
      if (edge.held_out || !OnItsEdge(i, edge, pose, stage.side_gate, &line)) continue;
      problem->AddResidualBlock(
          new LineCost(edge.p, line.direction, line.offset,
                       edge_weight / std::hypot(sigma, edge.sigma, kEdgeTolerance)),
          loss_.get(), state_.poses[i].values, &state_.offsets[i]);
    }
  }

  bool OnItsSide(std::size_t i, const SidePoint& point, const Pose& pose,
                 const Stage& stage) const {
    const Side& side = built_.SideOfLabel(point.label);
    const Eigen::Vector3d p = pose * Corrected(i, point.p);
    if ((side.ClosestPoint(p) - p).norm() > stage.side_gate) return false;
    // A label that leaks round an edge would pull its side sideways; the point's own normal gives
    // it away.
    return point.normal.isZero() || (pose.linear() * point.normal).dot(side.normal) > 0.7;
  }

  bool OnItsEdge(std::size_t i, const EdgePoint& edge, const Pose& pose, double gate,
                 EdgeLine* line) const {
    const Side& side = built_.SideOfLabel(edge.label);
    const Eigen::Vector3d p = pose * Corrected(i, edge.p);
    if (std::abs(side.normal.dot(p - side.centre)) > gate) return false;
    if ((pose.linear() * edge.normal).dot(side.normal) < 0.7) return false;
    return NearestEdge(side, p, pose.linear() * edge.outward, gate, line);
  }

  void AddOverlapTerms(std::size_t a, std::size_t b, const Stage& stage, double information,
                       ceres::Problem* problem) {
    const std::vector<Match> matches = FindMatches(a, b, stage.overlap_gate, stage.min_cosine);
    if (static_cast<double>(matches.size()) <
        std::max(20.0, options_.min_overlap * static_cast<double>(overlap_points_[a].size()))) {
      return;
    }
    const double sigma = std::max(std::hypot(sigma_[a], sigma_[b]), stage.scale);
    const double weight = std::sqrt(information) / sigma;
    for (const Match& match : matches) {
      const CloudPoint& from = sensors_[a].view->cloud[static_cast<std::size_t>(match.from)];
      const CloudPoint& to = sensors_[b].view->cloud[static_cast<std::size_t>(match.to)];
      if (from.held_out) continue;
      problem->AddResidualBlock(new OverlapCost(from.p, to.p, to.normal, weight), loss_.get(),
                                state_.poses[a].values, state_.poses[b].values, &state_.offsets[a],
                                &state_.offsets[b]);
    }
    if (Holds(a) && Holds(b)) return;
    // Where the structure does not hold a sensor, its silhouettes do: a convex edge also lies on
    // the face that only the other sensor sees, whose normal points across the silhouette.
    const Pose b_from_a = state_.poses[b].ToPose().inverse() * state_.poses[a].ToPose();
    for (const EdgePoint& edge : sensors_[a].view->edge_points) {
      if (edge.held_out) continue;
      const Eigen::Vector3d p = b_from_a * Corrected(a, edge.p);
      // Just behind the edge, where the other face is nearer than the common one.
      const Eigen::Vector3d probe = p - b_from_a.linear() * edge.normal * 0.02;
      const int j = sensors_[b].view->Nearest(probe, stage.overlap_gate + 0.02);
      if (j < 0) continue;
      const CloudPoint& to = sensors_[b].view->cloud[static_cast<std::size_t>(j)];
      if ((b_from_a.linear() * edge.outward).dot(to.normal) < 0.7) continue;
      if (std::abs(to.normal.dot(p - Corrected(b, to.p))) > stage.overlap_gate) continue;
      problem->AddResidualBlock(
          new OverlapCost(edge.p, to.p, to.normal,
                          weight * sigma / std::hypot(sigma, edge.sigma, kEdgeTolerance)),
          loss_.get(), state_.poses[a].values, state_.poses[b].values, &state_.offsets[a],
          &state_.offsets[b]);
    }
  }

  static ceres::Problem::Options ProblemOptions() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  void Minimise(ceres::Problem* problem) const {
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.max_num_iterations = options_.inner_iterations;
    solver.num_threads = options_.threads;
    solver.function_tolerance = 1e-7;
    solver.parameter_tolerance = 1e-9;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, problem, &summary);
  }

  void SolveCoarse(const Stage& stage) {
    ceres::Problem problem(ProblemOptions());
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      problem.AddParameterBlock(state_.poses[i].values, 7, &manifold_);
      problem.AddResidualBlock(new PosePriorCost(state_.poses[i].ToPose(), 1, 1), nullptr,
                               state_.poses[i].values);
      problem.AddParameterBlock(&state_.offsets[i], 1);
      problem.SetParameterBlockConstant(&state_.offsets[i]);
      if (Holds(i)) AddStructureTerms(i, stage, options_.edge_weight, &problem);
    }
    for (std::size_t a = 0; a < sensors_.size(); ++a) {
      for (std::size_t b = 0; b < sensors_.size(); ++b) {
        if (a != b && options_.max_overlap_points > 0)
          AddOverlapTerms(a, b, stage, options_.overlap_weight, &problem);
      }
    }
    Minimise(&problem);
    UpdateSigmas(stage);
  }

  /// Gathers points into observations, as they lie at the present state, with the noise model that
  /// explains them best.
  void CollectEvidence() {
    ParallelFor(sensors_.size(), options_.threads, [this](std::size_t i) {
      if (!Holds(i)) return;
      const std::vector<Pose> here = {state_.poses[i].ToPose()};
      CollectEvidence(i, true, here, &unseen_[i]);
      CollectEvidence(i, false, here, &evidence_[i]);
      Distrust(i, &evidence_[i]);
      FitNoise(model_, Parameters(i), priors_, &evidence_[i]);
    });
  }

  /// What decides between a sensor's refined and its initial pose: held-out points that lie on the
  /// structure from either.
  void CollectUnseen() {
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      if (!Holds(i)) continue;
      const Pose pose = state_.poses[i].ToPose();
      CollectEvidence(i, true, {pose, sensors_[i].initial}, &unseen_[i]);
      Distrust(i, &unseen_[i]);
      unseen_[i].noise = evidence_[i].noise;
      refine_internal::SetCovariance(model_, pose, &unseen_[i]);
    }
  }

  /// Of the points that lie on the structure from any of `poses`.
  void CollectEvidence(std::size_t i, bool held_out, const std::vector<Pose>& poses,
                       SensorEvidence* out) const {
    const Stage stage = StageOf(options_.outer_iterations);
    const Pose& pose = poses.front();
    SensorEvidence& evidence = *out;
    evidence.noise.line = BoxesAreFree() ? 0 : kHeldEdge;
    evidence.faces.clear();
    evidence.edges.clear();
    std::map<std::pair<int, int>, std::vector<const SidePoint*>> blocks;
    for (const SidePoint& point : sensors_[i].view->side_points) {
      if (point.held_out == held_out && std::any_of(poses.begin(), poses.end(), [&](const Pose& p) {
            return OnItsSide(i, point, p, stage);
          }))
        blocks[{point.label, point.block}].push_back(&point);
    }
    for (const auto& [key, points] : blocks) {
      constexpr std::size_t kFewest = 3;
      if (points.size() < kFewest) continue;
      const Side& side = built_.SideOfLabel(key.first);
      std::vector<double> distances;
      for (const SidePoint* point : points)
        distances.push_back(side.normal.dot(pose * Corrected(i, point->p) - side.centre));
      const double middle = MedianOf(distances);
      std::vector<double> deviations;
      for (const double d : distances) deviations.push_back(std::abs(d - middle));
      const double spread = 1.4826 * MedianOf(deviations) + 1e-3;
      FaceObservation face;
      face.label = key.first;
      face.p.setZero();
      double squares = 0;
      int count = 0;
      for (std::size_t k = 0; k < points.size(); ++k) {
        if (std::abs(distances[k] - middle) > 3 * spread) continue;
        face.p += points[k]->p;
        squares += (distances[k] - middle) * (distances[k] - middle);
        ++count;
      }
      face.p /= count;
      // Neighbours' errors are correlated over a pixel or two, hence twice.
      face.variance = 2 * squares / count / count;
      face.multipath =
          SeamShare(structure_, structure_.SideOfLabel(face.label), pose * Corrected(i, face.p));
      evidence.faces.push_back(face);
    }

    std::map<std::array<int, 4>, std::vector<const EdgePoint*>> lines;
    for (const EdgePoint& edge : sensors_[i].view->edge_points) {
      EdgeLine line;
      if (edge.held_out != held_out || std::none_of(poses.begin(), poses.end(), [&](const Pose& p) {
            return OnItsEdge(i, edge, p, stage.side_gate, &line);
          })) {
        continue;
      }
      lines[{edge.label, line.edge, edge.block, edge.axis}].push_back(&edge);
    }
    for (const auto& [key, points] : lines) {
      EdgeObservation edge;
      edge.label = key[0];
      edge.edge = key[1];
      edge.axis = key[3];
      edge.p.setZero();
      double pixels = 0;
      for (const EdgePoint* point : points) {
        edge.p += point->p;
        edge.pixel += point->pixel;
        pixels += point->sigma / point->pixel;
      }
      const auto count = static_cast<double>(points.size());
      edge.p /= count;
      edge.pixel /= count;
      pixels /= count;
      edge.variance = pixels * pixels / std::sqrt(count);
      evidence.edges.push_back(edge);
    }
  }

  bool BoxesAreFree() const {
    return std::all_of(free_.boxes.begin(), free_.boxes.end(), [](char f) { return f != 0; });
  }

  SensorParameters Parameters(std::size_t i) const {
    return {state_.poses[i].values, &state_.offsets[i], state_.nuisances[i].data(),
            state_.build.data()};
  }

  /// Observations that lie much farther off than a sensor's others, after a robust fit of this
  /// sensor alone, say little.
  void Distrust(std::size_t i, SensorEvidence* of) const {
    SensorEvidence& evidence = *of;
    const std::size_t faces = evidence.faces.size();
    Eigen::VectorXd sizes = RobustResiduals(i, evidence).cwiseAbs();
    for (std::size_t e = 0; e < evidence.edges.size(); ++e)
      sizes[static_cast<Eigen::Index>(faces + e)] /= evidence.edges[e].pixel;
    const auto distrust = [&](std::size_t first, std::size_t count, double least_spread,
                              const auto& variance) {
      const double spread = std::max(least_spread, Spread(sizes, first, count));
      for (std::size_t k = 0; k < count; ++k) {
        const double size = sizes[static_cast<Eigen::Index>(first + k)];
        const double limit = 2.5 * spread;
        if (size > limit) *variance(k) += 4 * (size * size - limit * limit);
      }
    };
    distrust(0, faces, 1e-3, [&](std::size_t k) { return &evidence.faces[k].variance; });
    distrust(faces, evidence.edges.size(), 0.3,
             [&](std::size_t k) { return &evidence.edges[k].variance; });
  }

  /// Robust standard deviation of a part of `sizes`.
  static double Spread(const Eigen::VectorXd& sizes, std::size_t first, std::size_t count) {
    return 1.4826 *
           MedianOf(std::vector<double>(sizes.data() + first, sizes.data() + first + count));
  }

  /// Residuals of a sensor's observations, m, after least squares of its own parameters, reweighted
  /// by Cauchy's function.
  Eigen::VectorXd RobustResiduals(std::size_t i, const SensorEvidence& evidence) const {
    Eigen::VectorXd r;
    Eigen::MatrixXd ambient;
    refine_internal::Residuals(model_, evidence, Parameters(i), &r, &ambient);
    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    manifold_.PlusJacobian(state_.poses[i].values, plus.data());
    Eigen::MatrixXd j(ambient.rows(), ambient.cols() - 1);
    j << ambient.leftCols<7>() * plus, ambient.rightCols(ambient.cols() - 7);
    Eigen::VectorXd prior(j.cols());
    prior << Eigen::VectorXd::Constant(6, 1), Least(priors_.offset), Least(priors_.gain), 0.02,
        Least(priors_.edge_shift), Least(priors_.edge_shift), Eigen::VectorXd::Zero(model_.size());
    const std::vector<double> build = BuildSigmas();
    for (std::size_t k = 0; k < build.size(); ++k)
      prior[6 + 1 + kNuisances + static_cast<Eigen::Index>(k)] = build[k];

    const std::size_t faces = evidence.faces.size(), edges = evidence.edges.size();
    Eigen::VectorXd unit = Eigen::VectorXd::Ones(r.size());
    for (std::size_t e = 0; e < edges; ++e)
      unit[static_cast<Eigen::Index>(faces + e)] = evidence.edges[e].pixel;
    Eigen::VectorXd left = r;
    for (int iteration = 0; iteration < 8; ++iteration) {
      const Eigen::VectorXd sizes = left.cwiseAbs().cwiseQuotient(unit);
      const double face = std::max(0.002, Spread(sizes, 0, faces));
      const double edge = std::max(0.3, Spread(sizes, faces, edges));
      Eigen::VectorXd weights(r.size());
      for (Eigen::Index k = 0; k < r.size(); ++k) {
        const double sigma = unit[k] * (k < static_cast<Eigen::Index>(faces) ? face : edge);
        weights[k] = 1 / (Square(sigma) + Square(left[k]));
      }
      Eigen::MatrixXd h = j.transpose() * weights.asDiagonal() * j;
      h.diagonal() += prior.cwiseAbs2().cwiseInverse();
      left = r - j * h.ldlt().solve(j.transpose() * (weights.asDiagonal() * r));
    }
    return left;
  }

  /// Points that two sensors see, and that the structure does not hold already. Errors within a
  /// correlation length are one error.
  void AddFineOverlap(std::size_t a, std::size_t b, ceres::Problem* problem) {
    Stage stage = StageOf(options_.outer_iterations);
    stage.overlap_gate = kFineOverlapGate;
    const bool held = Holds(a) && Holds(b);
    if (held && (fixed_[a] || fixed_[b])) return;
    const Pose pose = state_.poses[a].ToPose();
    struct Weighted {
      const CloudPoint *from, *to;
      double sigma;
    };
    std::vector<Weighted> kept;
    std::vector<double> sizes;
    std::set<std::pair<int, int>> cells;
    const double cell = std::max(evidence_[a].noise.warp_length, evidence_[b].noise.warp_length);
    const auto spread = [&](std::size_t i, const Eigen::Vector3d& p) {
      return std::hypot(std::max(evidence_[i].noise.warp, 1e-3) * p.z() * p.z() / 4,
                        kIntrinsicsError * p.head<2>().norm());
    };
    for (const Match& match : FindMatches(a, b, stage.overlap_gate, stage.min_cosine)) {
      const CloudPoint& from = sensors_[a].view->cloud[static_cast<std::size_t>(match.from)];
      const CloudPoint& to = sensors_[b].view->cloud[static_cast<std::size_t>(match.to)];
      if (from.held_out) continue;
      const double sigma = std::hypot(spread(a, from.p), spread(b, to.p));
      if (held) {
        if (sigma > stage.overlap_gate / 2) continue;
        if (DistanceToSurface(built_, pose * Corrected(a, from.p)).distance < kOffStructure)
          continue;
      }
      kept.push_back({&from, &to, sigma});
      sizes.push_back(std::abs(match.residual) / sigma);
      cells.insert({static_cast<int>(std::floor(from.p.x() / from.p.z() / cell)),
                    static_cast<int>(std::floor(from.p.y() / from.p.z() / cell))});
    }
    if (kept.size() < 20) return;
    const double excess = std::max(1.0, 1.4826 * MedianOf(sizes));
    const double share =
        std::sqrt(static_cast<double>(cells.size()) / static_cast<double>(kept.size())) / excess;
    for (const Weighted& match : kept) {
      problem->AddResidualBlock(
          new OverlapCost(match.from->p, match.to->p, match.to->normal, share / match.sigma),
          loss_.get(), state_.poses[a].values, state_.poses[b].values, &state_.offsets[a],
          &state_.offsets[b]);
    }
  }

  /// The problem of the last stage. `everything`: as if all were estimated, for the posterior.
  std::unique_ptr<ceres::Problem> BuildFine(bool everything) {
    auto problem = std::make_unique<ceres::Problem>(ProblemOptions());
    subsets_.clear();
    double* build = state_.build.data();
    problem->AddParameterBlock(build, model_.size());
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      double *pose = state_.poses[i].values, *offset = &state_.offsets[i],
             *nuisance = state_.nuisances[i].data();
      problem->AddParameterBlock(pose, 7, &manifold_);
      problem->AddParameterBlock(offset, 1);
      problem->AddParameterBlock(nuisance, kNuisances);
      problem->AddResidualBlock(new PosePriorCost(state_.poses[i].ToPose(), 1, 1), nullptr, pose);
      if (fixed_[i] && !everything) {
        problem->SetParameterBlockConstant(pose);
        problem->SetParameterBlockConstant(offset);
        problem->SetParameterBlockConstant(nuisance);
        continue;
      }
      problem->AddResidualBlock(new PriorCost({Least(priors_.offset)}), nullptr, offset);
      problem->AddResidualBlock(
          new PriorCost({Least(priors_.gain), Least(evidence_[i].noise.multipath),
                         Least(priors_.edge_shift), Least(priors_.edge_shift)}),
          nullptr, nuisance);
      if (Holds(i) && !evidence_[i].faces.empty()) {
        problem->AddResidualBlock(new SensorCost(model_, evidence_[i]), nullptr, pose, offset,
                                  nuisance, build);
      }
      if (everything) continue;
      if (!free_.offset[i]) problem->SetParameterBlockConstant(offset);
      if (!free_.gain[i]) Hold({kDepthGain}, kNuisances, nuisance, problem.get());
    }
    problem->AddResidualBlock(new PriorCost(BuildSigmas()), nullptr, build);
    if (!everything) {
      std::vector<int> held;
      if (!free_.size) held.push_back(0);
      for (int b = 0; b < static_cast<int>(free_.boxes.size()); ++b) {
        if (free_.boxes[static_cast<std::size_t>(b)]) continue;
        held.insert(held.end(), {BuildModel::X(b), BuildModel::Z(b), BuildModel::Yaw(b)});
      }
      Hold(held, model_.size(), build, problem.get());
    }
    for (std::size_t a = 0; a < sensors_.size(); ++a) {
      for (std::size_t b = 0; b < sensors_.size(); ++b) {
        if (a != b && options_.max_overlap_points > 0) AddFineOverlap(a, b, problem.get());
      }
    }
    return problem;
  }

  static double Least(double sigma) { return std::max(sigma, 1e-6); }

  std::vector<double> BuildSigmas() const {
    std::vector<double> sigmas = {Least(priors_.size)};
    for (std::size_t b = 0; b < structure_.boxes().size(); ++b)
      sigmas.insert(sigmas.end(), {Least(priors_.box), Least(priors_.box), Least(priors_.yaw)});
    return sigmas;
  }

  void Hold(const std::vector<int>& held, int size, double* block, ceres::Problem* problem) {
    if (held.empty()) return;
    if (static_cast<int>(held.size()) == size) return problem->SetParameterBlockConstant(block);
    subsets_.push_back(std::make_unique<ceres::SubsetManifold>(size, held));
    problem->SetManifold(block, subsets_.back().get());
  }

  void SolveFine() {
    const std::unique_ptr<ceres::Problem> problem = BuildFine(false);
    Minimise(problem.get());
    built_ = model_.Built(state_.build.data());
    UpdateSigmas(StageOf(options_.outer_iterations));
  }

  /// Columns that are held at zero.
  std::vector<char> Held(const Free& free) const {
    std::vector<char> held(static_cast<std::size_t>(BuildColumn() + model_.size()), 0);
    const auto at = [&](Eigen::Index i) -> char& { return held[static_cast<std::size_t>(i)]; };
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      at(OffsetColumn(i)) = !free.offset[i];
      at(NuisanceColumn(i) + kDepthGain) = !free.gain[i];
    }
    at(BuildColumn()) = !free.size;
    for (int b = 0; b < static_cast<int>(free.boxes.size()); ++b) {
      for (const int k : {BuildModel::X(b), BuildModel::Z(b), BuildModel::Yaw(b)})
        at(BuildColumn() + k) = !free.boxes[static_cast<std::size_t>(b)];
    }
    return held;
  }

  /// Of the last stage's cost with everything free: J^T J and J^T r, in tangent spaces.
  Normal ComputeNormal() {
    const std::unique_ptr<ceres::Problem> problem = BuildFine(true);
    ceres::Problem::EvaluateOptions evaluation;
    for (PoseBlock& pose : state_.poses) evaluation.parameter_blocks.push_back(pose.values);
    for (double& offset : state_.offsets) evaluation.parameter_blocks.push_back(&offset);
    for (auto& nuisance : state_.nuisances) evaluation.parameter_blocks.push_back(nuisance.data());
    evaluation.parameter_blocks.push_back(state_.build.data());
    evaluation.num_threads = options_.threads;
    ceres::CRSMatrix jacobian;
    const Eigen::Index size = BuildColumn() + model_.size();
    Normal normal;
    Eigen::MatrixXd& information = normal.information;
    information = Eigen::MatrixXd::Zero(size, size);
    std::vector<double> gradient;
    problem->Evaluate(evaluation, nullptr, nullptr, &gradient, &jacobian);
    normal.gradient = Eigen::Map<const Eigen::VectorXd>(gradient.data(), size);
    for (int row = 0; row < jacobian.num_rows; ++row) {
      const auto begin = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row)]);
      const auto end = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row) + 1]);
      for (std::size_t i = begin; i < end; ++i) {
        if (jacobian.values[i] == 0) continue;
        for (std::size_t j = begin; j < end; ++j)
          information(jacobian.cols[i], jacobian.cols[j]) +=
              jacobian.values[i] * jacobian.values[j];
      }
    }
    return normal;
  }

  /// Covariance with everything free; where something was not to be estimated, plus how far from
  /// here a step with it would lead, as a square; and for a shift of silhouettes that all sensors
  /// share.
  Posterior ComputePosterior(const Normal& normal) const {
    const Eigen::MatrixXd& h = normal.information;
    const Eigen::LLT<Eigen::MatrixXd> root(h);
    Posterior posterior;
    posterior.covariance = root.solve(Eigen::MatrixXd::Identity(h.rows(), h.cols()));
    const std::vector<char> held = Held(asked_);
    if (std::any_of(held.begin(), held.end(), [](char f) { return f != 0; })) {
      const Eigen::VectorXd step = root.solve(normal.gradient);
      posterior.covariance += step * step.transpose();
    }
    // What silhouettes are shifted by in all sensors alike looks like another size.
    Eigen::VectorXd common = Eigen::VectorXd::Zero(h.rows());
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      for (const int shift : {kEdgeShift, kEdgeShift + 1}) {
        const Eigen::Index column = NuisanceColumn(i) + shift;
        common += h.col(column);
        common[column] -= 1 / Square(Least(priors_.edge_shift));
      }
    }
    const Eigen::VectorXd moved = kCommonEdgeShift * root.solve(common);
    posterior.covariance += moved * moved.transpose();
    return posterior;
  }

  /// Zero for the poses.
  Eigen::VectorXd PriorVariances() const {
    Eigen::VectorXd variances = Eigen::VectorXd::Zero(BuildColumn() + model_.size());
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      variances[OffsetColumn(i)] = Square(Least(priors_.offset));
      variances[NuisanceColumn(i) + kDepthGain] = Square(Least(priors_.gain));
      variances[NuisanceColumn(i) + kMultipath] = Square(Least(evidence_[i].noise.multipath));
      for (const int shift : {kEdgeShift, kEdgeShift + 1})
        variances[NuisanceColumn(i) + shift] = Square(Least(priors_.edge_shift));
    }
    const std::vector<double> build = BuildSigmas();
    for (std::size_t k = 0; k < build.size(); ++k)
      variances[BuildColumn() + static_cast<Eigen::Index>(k)] = Square(build[k]);
    return variances;
  }
  static double Square(double x) { return x * x; }

  /// Projection of box displacements (x, z, yaw of each) along the gauge, in which all boxes move
  /// as one, to those that the prior finds likeliest.
  Eigen::MatrixXd GaugeProjection() const {
    const auto boxes = static_cast<Eigen::Index>(structure_.boxes().size());
    Eigen::MatrixXd gauge = Eigen::MatrixXd::Zero(3 * boxes, 3);
    Eigen::VectorXd precision(3 * boxes);
    for (Eigen::Index b = 0; b < boxes; ++b) {
      const Eigen::Vector3d centre =
          structure_.boxes()[static_cast<std::size_t>(b)].structure_from_box.translation();
      gauge(3 * b, 0) = gauge(3 * b + 1, 1) = gauge(3 * b + 2, 2) = 1;
      gauge(3 * b, 2) = centre.z();
      gauge(3 * b + 1, 2) = -centre.x();
      precision[3 * b] = precision[3 * b + 1] = 1 / Square(Least(priors_.box));
      precision[3 * b + 2] = 1 / Square(Least(priors_.yaw));
    }
    const Eigen::MatrixXd weighted = precision.asDiagonal() * gauge;
    const Eigen::Matrix3d inner = gauge.transpose() * weighted;
    return Eigen::MatrixXd::Identity(3 * boxes, 3 * boxes) -
           gauge * inner.inverse() * weighted.transpose();
  }

  /// Does a sensor that was refined?
  bool Sees(int box) const {
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      if (fixed_[i]) continue;
      for (const FaceObservation& face : evidence_[i].faces) {
        if (structure_.SideOfLabel(face.label).box == box) return true;
      }
    }
    return false;
  }

  Eigen::VectorXd BoxSigmas(const Posterior& posterior) const {
    const auto n = static_cast<Eigen::Index>(3 * structure_.boxes().size());
    const Eigen::MatrixXd projection = GaugeProjection();
    const Eigen::MatrixXd covariance =
        projection * posterior.covariance.block(BuildColumn() + 1, BuildColumn() + 1, n, n) *
        projection.transpose();
    return covariance.diagonal().cwiseMax(0).cwiseSqrt();
  }

  /// Keeps those parameters that the capture tells clearly more about than their priors do, of
  /// kinds without which the points that no solution has seen do not fit as well. The others are
  /// held at their nominal values; the covariance knows that they are uncertain.
  void KeepWhatTheCaptureTells() {
    Free kept = free_;
    const Normal normal = ComputeNormal();
    Posterior posterior = ComputePosterior(normal);
    const auto observable = [&](Eigen::Index column, double prior) {
      return posterior.Sigma(column) < kObservable * prior;
    };
    kept.size = free_.size && observable(BuildColumn(), priors_.size);
    const Eigen::MatrixXd projection = GaugeProjection();
    const Eigen::VectorXd variances = PriorVariances().tail(projection.rows());
    const Eigen::VectorXd prior =
        (projection * variances.asDiagonal() * projection.transpose()).diagonal();
    const Eigen::VectorXd sigmas = BoxSigmas(posterior);
    for (std::size_t b = 0; b < free_.boxes.size(); ++b) {
      const auto k = static_cast<Eigen::Index>(3 * b);
      for (Eigen::Index j = k; j < k + 2; ++j) {
        // A single box is nothing but gauge.
        const bool clear = prior[j] > 1e-12 && Square(sigmas[j]) < Square(kObservable) * prior[j];
        kept.boxes[b] = kept.boxes[b] && clear;
      }
    }
    for (std::size_t i = 0; i < sensors_.size(); ++i)
      kept.gain[i] = free_.gain[i] && observable(NuisanceColumn(i) + kDepthGain, priors_.gain);
    // A scale that is held leaves the offset to stand for both at the structure's distance.
    free_.gain = kept.gain;
    posterior.covariance = InverseWithout(normal.information, Held(free_));
    for (std::size_t i = 0; i < sensors_.size(); ++i)
      kept.offset[i] = free_.offset[i] && observable(OffsetColumn(i), priors_.offset);
    free_ = kept;
    ResetUnless(free_, &state_);
    SetLineTolerance();
    SolveFine();

    const std::array<std::function<bool(Free*)>, 4> kinds = {
        [](Free* f) { return Clear(&f->boxes); },
        [](Free* f) { return std::exchange(f->size, false); },
        [](Free* f) { return Clear(&f->gain); }, [](Free* f) { return Clear(&f->offset); }};
    for (const auto& drop : kinds) {
      const Free with = free_;
      if (!drop(&free_)) continue;
      const State state = state_;
      const Structure built = built_;
      const std::vector<double> sigma = sigma_;
      const double cost = UnseenCost();
      ResetUnless(free_, &state_);
      SetLineTolerance();
      SolveFine();
      // Within the held-out cost's own noise, what the posterior says decides.
      constexpr double kNoise = 0.03;
      if (UnseenCost() < (1 - kNoise) * cost) continue;
      free_ = with;
      state_ = state;
      built_ = built;
      sigma_ = sigma;
      SetLineTolerance();
    }
  }

  /// Mean robust cost of the held-out observations under the whole model.
  double UnseenCost() const {
    constexpr double kUnseenScale = 0.005;  // m
    double sum = 0;
    int count = 0;
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      if (!Holds(i)) continue;
      Eigen::VectorXd r;
      refine_internal::Residuals(model_, unseen_[i], Parameters(i), &r, nullptr);
      for (const double distance : r) sum += RobustCost(distance, kUnseenScale);
      count += static_cast<int>(r.size());
    }
    return count > 0 ? sum / count : 0;
  }

  void SetLineTolerance() {
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      if (!Holds(i)) continue;
      evidence_[i].noise.line = BoxesAreFree() ? 0 : kHeldEdge;
      refine_internal::SetCovariance(model_, state_.poses[i].ToPose(), &evidence_[i]);
    }
  }

  /// Posterior covariance where the held parameters are known.
  static Eigen::MatrixXd InverseWithout(const Eigen::MatrixXd& information,
                                        const std::vector<char>& held) {
    Eigen::MatrixXd h = information;
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (!held[i]) continue;
      const auto k = static_cast<Eigen::Index>(i);
      h.row(k).setZero();
      h.col(k).setZero();
      h(k, k) = 1;
    }
    return h.llt().solve(Eigen::MatrixXd(Eigen::MatrixXd::Identity(h.rows(), h.cols())));
  }

  /// Nominal values for what is not in `some`.
  void ResetUnless(const Free& some, State* state) const {
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      if (!some.offset[i]) state->offsets[i] = 0;
      if (!some.gain[i]) state->nuisances[i][kDepthGain] = 0;
    }
    if (!some.size) state->build[0] = 0;
    for (std::size_t b = 0; b < some.boxes.size(); ++b) {
      if (some.boxes[b]) continue;
      std::fill_n(state->build.begin() + BuildModel::X(static_cast<int>(b)), 3, 0.0);
    }
  }

  /// Gauge: the mean displacement of the estimated boxes is zero. The priors all but see to it.
  void CentreBoxes() {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    int count = 0;
    for (int b = 0; b < static_cast<int>(free_.boxes.size()); ++b) {
      if (!free_.boxes[static_cast<std::size_t>(b)]) continue;
      mean.x() += state_.build[static_cast<std::size_t>(BuildModel::X(b))];
      mean.z() += state_.build[static_cast<std::size_t>(BuildModel::Z(b))];
      ++count;
    }
    if (count == 0) return;
    mean /= count;
    for (int b = 0; b < static_cast<int>(free_.boxes.size()); ++b) {
      if (!free_.boxes[static_cast<std::size_t>(b)]) continue;
      state_.build[static_cast<std::size_t>(BuildModel::X(b))] -= mean.x();
      state_.build[static_cast<std::size_t>(BuildModel::Z(b))] -= mean.z();
    }
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      if (!fixed_[i]) Eigen::Map<Eigen::Vector3d>(state_.poses[i].values + 4) -= mean;
    }
    built_ = model_.Built(state_.build.data());
  }

  static bool Clear(std::vector<char>* flags) {
    const bool any = std::any_of(flags->begin(), flags->end(), [](char f) { return f != 0; });
    std::fill(flags->begin(), flags->end(), 0);
    return any;
  }

  void UpdateSigmas(const Stage& stage) {
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      const Pose pose = state_.poses[i].ToPose();
      std::vector<double> distances;
      for (const SidePoint& point : sensors_[i].view->side_points) {
        if (!OnItsSide(i, point, pose, stage)) continue;
        const Eigen::Vector3d p = pose * Corrected(i, point.p);
        distances.push_back((built_.SideOfLabel(point.label).ClosestPoint(p) - p).norm());
      }
      if (!Holds(i)) continue;
      constexpr double kMedianToSigma = 1.4826;
      sigma_[i] = std::max(kMinResidualSigma, kMedianToSigma * MedianOf(distances));
    }
  }

  /// How a pose explains the points that no solution has seen, whatever the sensor's own depth
  /// errors are. Distances alone would favour poses that follow the sensor's warp, the misfit alone
  /// trusts the noise model.
  struct HeldOut {
    double misfit = 0;    ///< mean square in standard deviations, as errors are correlated
    double distance = 0;  ///< m, mean absolute distance, depth errors as estimated taken out
  };

  HeldOut ComputeHeldOut(std::size_t i, const Pose& pose) const {
    if (!Holds(i)) {
      const double cost = HeldOutOverlap(i, pose);
      return {cost, cost};
    }
    const SensorEvidence& evidence = unseen_[i];
    if (evidence.faces.empty()) return {};
    const PoseBlock block(pose);
    constexpr std::array<double, kNuisances> kNone = {};
    const double no_offset = 0;
    Eigen::VectorXd r;
    Eigen::MatrixXd jacobian;
    refine_internal::Residuals(model_, evidence,
                               {block.values, &no_offset, kNone.data(), state_.build.data()}, &r,
                               &jacobian);
    Eigen::Matrix<double, 1 + kNuisances, 1> sigmas;
    sigmas << priors_.offset, priors_.gain, evidence.noise.multipath, priors_.edge_shift,
        priors_.edge_shift;
    const Eigen::MatrixXd shared = jacobian.middleCols<1 + kNuisances>(7) * sigmas.asDiagonal();
    const auto faces = static_cast<Eigen::Index>(evidence.faces.size());
    const auto edges = static_cast<Eigen::Index>(evidence.edges.size());
    Eigen::MatrixXd covariance = shared * shared.transpose();
    covariance.topLeftCorner(faces, faces) += evidence.face_root * evidence.face_root.transpose();
    covariance.bottomRightCorner(edges, edges) +=
        evidence.edge_root * evidence.edge_root.transpose();
    HeldOut result;
    result.misfit = r.dot(covariance.llt().solve(r)) / static_cast<double>(r.size());
    SensorParameters estimated = Parameters(i);
    estimated.pose = block.values;
    refine_internal::Residuals(model_, evidence, estimated, &r, nullptr);
    result.distance = r.cwiseAbs().mean();
    return result;
  }

  /// Mean robust cost of held-out points against what other sensors see.
  double HeldOutOverlap(std::size_t i, const Pose& pose) const {
    double sum = 0;
    int count = 0;
    for (std::size_t other = 0; other < sensors_.size(); ++other) {
      if (other == i) continue;
      const Pose other_from_this = state_.poses[other].ToPose().inverse() * pose;
      for (const int j : overlap_points_[i]) {
        const CloudPoint& from = sensors_[i].view->cloud[static_cast<std::size_t>(j)];
        if (!from.held_out) continue;
        const Eigen::Vector3d p = other_from_this * Corrected(i, from.p);
        const int nearest = sensors_[other].view->Nearest(p, 0.1);
        if (nearest < 0) continue;
        const CloudPoint& to = sensors_[other].view->cloud[static_cast<std::size_t>(nearest)];
        if ((other_from_this.linear() * from.normal).dot(to.normal) < 0.7) continue;
        sum += RobustCost(to.normal.dot(p - Corrected(other, to.p)), kFaceScale);
        ++count;
      }
    }
    return count > 0 ? sum / count : 0;
  }

  std::vector<RefinedPair> Pairs() const {
    const Stage stage = StageOf(options_.outer_iterations);
    std::vector<RefinedPair> pairs;
    for (std::size_t a = 0; a < sensors_.size(); ++a) {
      for (std::size_t b = a + 1; b < sensors_.size(); ++b) {
        std::vector<Match> matches = FindMatches(a, b, stage.overlap_gate, stage.min_cosine);
        const std::vector<Match> back = FindMatches(b, a, stage.overlap_gate, stage.min_cosine);
        matches.insert(matches.end(), back.begin(), back.end());
        const std::size_t offered = overlap_points_[a].size() + overlap_points_[b].size();
        if (matches.empty() || static_cast<double>(matches.size()) <
                                   options_.min_overlap * static_cast<double>(offered)) {
          continue;
        }
        double squares = 0;
        for (const Match& match : matches) squares += match.residual * match.residual;
        const auto count = static_cast<double>(matches.size());
        pairs.push_back({static_cast<int>(a), static_cast<int>(b),
                         count / static_cast<double>(offered), std::sqrt(squares / count)});
      }
    }
    return pairs;
  }

  const Structure& structure_;
  const std::vector<RefineSensor>& sensors_;
  const RefineOptions& options_;
  const EstimateSet wanted_;
  const BuildModel model_;
  Priors priors_;
  State state_;
  Free asked_, free_;                              // at first, and what is left of it
  Structure built_;                                // as state_.build has it
  std::vector<double> sigma_;                      // m, per sensor
  std::vector<char> fixed_;                        // sensors that went back to their initial poses
  std::vector<SensorEvidence> evidence_, unseen_;  // of the points that are solved for; held out
  std::vector<std::unique_ptr<ceres::Manifold>> subsets_;
  std::vector<std::vector<int>> overlap_points_;
  LeftPoseManifold manifold_;
  std::unique_ptr<ceres::LossFunction> loss_ = std::make_unique<ceres::CauchyLoss>(2.0);
};

}  // namespace

EstimateSet ParseEstimate(const std::string& text) {
  EstimateSet set;
  if (text == "none") return set;
  if (text == "auto") return {true, true, true, true};
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    std::string word = text.substr(begin, end - begin);
    word.erase(std::remove(word.begin(), word.end(), ' '), word.end());
    if (word == "boxes") {
      set.boxes = true;
    } else if (word == "size") {
      set.size = true;
    } else if (word == "depth_gain") {
      set.depth_gain = true;
    } else if (word == "depth_offset") {
      set.depth_offset = true;
    } else {
      throw ConfigError(fmt::format(
          "refine.estimate = \"{}\": \"{}\" is none of boxes, size, depth_gain, depth_offset; or "
          "give auto or none alone",
          text, word));
    }
    begin = end + 1;
  }
  return set;
}

std::vector<std::string> UnconstrainedDirections(const Matrix6d& covariance) {
  constexpr double kOpenTranslation = 0.03, kOpenRotation = 2 * M_PI / 180;
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
      constexpr double kAligned = 0.94;  // cos 20 deg
      std::string name = main == 1 ? "the vertical" : main == 0 ? "structure x" : "structure z";
      if (axis[main] < kAligned)
        name = fmt::format("structure ({:.2f}, {:.2f}, {:.2f})", axis.x(), axis.y(), axis.z());
      names.push_back(rotation ? fmt::format("about {} ({:.1f} deg)", name, sigma * 180 / M_PI)
                               : fmt::format("along {} ({:.2f} m)", name, sigma));
    }
  }
  return names;
}

RefineResult Refine(const Structure& structure, const std::vector<RefineSensor>& sensors,
                    const RefineOptions& options) {
  if (sensors.empty()) {
    ParseEstimate(options.estimate);
    RefineResult nothing;
    nothing.boxes.resize(structure.boxes().size());
    nothing.built = structure;
    return nothing;
  }
  return JointProblem(structure, sensors, options).Run();
}

}  // namespace volalign
