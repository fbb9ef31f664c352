#include "infer/refine.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "infer/refine_costs.h"

namespace volalign {

namespace {

using refine_internal::LeftPoseManifold;
using refine_internal::LineCost;
using refine_internal::OffsetPriorCost;
using refine_internal::OverlapCost;
using refine_internal::PoseBlock;
using refine_internal::PosePriorCost;
using refine_internal::SideCost;

// m, of the cost that decides about acceptance: distances to faces, and to edge lines.
constexpr double kFaceScale = 0.01, kLineScale = 0.03;
/// m: how far a real box's edges stray from where the structure has them, beyond what its faces do.
/// On the three real captures it was 10-30 mm for faces that fit to 4 mm: boxes are placed by hand,
/// cardboard bulges, and sensors fatten edges.
constexpr double kEdgeTolerance = 0.008;
constexpr double kMinResidualSigma = 5e-4;  // m: below it the depth's own resolution counts

/// Gates and scales of one association, coarse to fine.
struct Stage {
  double side_gate;     // m, distance of a labelled point to its side
  double overlap_gate;  // m, distance of matched points
  double min_cosine;    // between matched normals
  double scale;         // m, least standard deviation that residuals are whitened with
};

Stage StageOf(int iteration) {
  const double shrink = std::pow(0.6, iteration);
  return {std::max(0.15 * shrink, 0.03), std::max(0.12 * shrink, 0.02),
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
      *line = {direction, offset};
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
        sigma_(sensors.size(), 0.005),
        offset_(sensors.size(), 0) {
    for (std::size_t i = 0; i < sensors.size(); ++i) {
      blocks_.emplace_back(sensors[i].start);
      offset_[i] = sensors[i].start_offset;
    }
    ChooseOverlapPoints();
  }

  RefineResult Run() {
    RefineResult result;
    std::vector<char> fixed(sensors_.size(), 0);
    std::vector<double> before(sensors_.size());
    for (std::size_t i = 0; i < sensors_.size(); ++i)
      before[i] = HeldOutCost(i, sensors_[i].initial, 0);

    for (int iteration = 0; iteration < options_.outer_iterations; ++iteration) {
      Solve(StageOf(iteration), fixed, options_.inner_iterations);
    }
    // A sensor that goes back may have pulled its neighbours: they are solved again around it.
    for (std::size_t round = 0; round < sensors_.size(); ++round) {
      bool changed = false;
      for (std::size_t i = 0; i < sensors_.size(); ++i) {
        if (fixed[i] || HeldOutCost(i, blocks_[i].ToPose(), offset_[i]) < before[i]) continue;
        blocks_[i] = PoseBlock(sensors_[i].initial);
        offset_[i] = 0;
        fixed[i] = 1;
        changed = true;
      }
      if (!changed || std::all_of(fixed.begin(), fixed.end(), [](char f) { return f != 0; })) break;
      for (int i = 0; i < 2; ++i)
        Solve(StageOf(options_.outer_iterations), fixed, options_.inner_iterations);
    }
    const std::vector<Matrix6d> covariances = Covariances();
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      RefinedSensor sensor;
      sensor.accepted = !fixed[i];
      sensor.structure_from_sensor = fixed[i] ? sensors_[i].initial : blocks_[i].ToPose();
      sensor.depth_offset = offset_[i];
      sensor.held_out_before = before[i];
      sensor.held_out_after = HeldOutCost(i, sensor.structure_from_sensor, offset_[i]);
      sensor.covariance = covariances[i];
      sensor.residual_sigma = sigma_[i];
      result.sensors.push_back(sensor);
    }
    result.pairs = Pairs();
    return result;
  }

 private:
  /// Information of a silhouette or overlap residual, where one to a side counts 1.
  struct Weights {
    double edge, overlap;
  };
  struct Match {
    int from, to;     // indices into the clouds of a and b
    double residual;  // m
  };

  Eigen::Vector3d Corrected(std::size_t i, const Eigen::Vector3d& p) const {
    return p * (1 + offset_[i] / p.z());
  }
  bool Holds(std::size_t i) const { return sensors_[i].use_structure_terms; }

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
    const Pose b_from_a = blocks_[b].ToPose().inverse() * blocks_[a].ToPose();
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
    const Pose pose = blocks_[i].ToPose();
    const double sigma = std::max(sigma_[i], stage.scale);
    for (const SidePoint& point : sensors_[i].view->side_points) {
      if (point.held_out || !OnItsSide(i, point, pose, stage)) continue;
      problem->AddResidualBlock(
          new SideCost(point.p, structure_.SideOfLabel(point.label), 1 / sigma), loss_.get(),
          blocks_[i].values, &offset_[i]);
    }
    const double edge_weight = std::sqrt(edge_information);
    for (const EdgePoint& edge : sensors_[i].view->edge_points) {
      EdgeLine line;
      if (edge.held_out || !OnItsEdge(i, edge, pose, stage.side_gate, &line)) continue;
      problem->AddResidualBlock(
          new LineCost(edge.p, line.direction, line.offset,
                       edge_weight / std::hypot(sigma, edge.sigma, kEdgeTolerance)),
          loss_.get(), blocks_[i].values, &offset_[i]);
    }
  }

  bool OnItsSide(std::size_t i, const SidePoint& point, const Pose& pose,
                 const Stage& stage) const {
    const Side& side = structure_.SideOfLabel(point.label);
    const Eigen::Vector3d p = pose * Corrected(i, point.p);
    if ((side.ClosestPoint(p) - p).norm() > stage.side_gate) return false;
    // A label that leaks round an edge would pull its side sideways; the point's own normal gives
    // it away.
    return point.normal.isZero() || (pose.linear() * point.normal).dot(side.normal) > 0.7;
  }

  bool OnItsEdge(std::size_t i, const EdgePoint& edge, const Pose& pose, double gate,
                 EdgeLine* line) const {
    const Side& side = structure_.SideOfLabel(edge.label);
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
                                blocks_[a].values, blocks_[b].values, &offset_[a], &offset_[b]);
    }
    if (Holds(a) && Holds(b)) return;
    // Where the structure does not hold a sensor, its silhouettes do: a convex edge also lies on
    // the face that only the other sensor sees, whose normal points across the silhouette.
    const Pose b_from_a = blocks_[b].ToPose().inverse() * blocks_[a].ToPose();
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
          loss_.get(), blocks_[a].values, blocks_[b].values, &offset_[a], &offset_[b]);
    }
  }

  std::unique_ptr<ceres::Problem> Build(const Stage& stage, const std::vector<char>& fixed,
                                        const Weights& weights) {
    ceres::Problem::Options problem_options;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    auto problem = std::make_unique<ceres::Problem>(problem_options);
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      problem->AddParameterBlock(blocks_[i].values, 7, &manifold_);
      problem->AddResidualBlock(new PosePriorCost(blocks_[i].ToPose(), 1, 1), nullptr,
                                blocks_[i].values);
      if (Holds(i)) AddStructureTerms(i, stage, weights.edge, problem.get());
      problem->AddParameterBlock(&offset_[i], 1);
      const bool stands = !fixed.empty() && fixed[i];
      if (stands) problem->SetParameterBlockConstant(blocks_[i].values);
      if (options_.depth_offset_sigma_m > 0 && !stands) {
        // Points of a sensor say less than their number, and the prior has to be weighed against
        // what they say.
        problem->AddResidualBlock(
            new OffsetPriorCost(options_.depth_offset_sigma_m / std::sqrt(DesignEffect(i, stage))),
            nullptr, &offset_[i]);
      } else {
        problem->SetParameterBlockConstant(&offset_[i]);
      }
    }
    for (std::size_t a = 0; a < sensors_.size(); ++a) {
      for (std::size_t b = 0; b < sensors_.size(); ++b) {
        if (a != b && options_.max_overlap_points > 0) {
          AddOverlapTerms(a, b, stage, weights.overlap, problem.get());
        }
      }
    }
    return problem;
  }

  void Solve(const Stage& stage, const std::vector<char>& fixed, int iterations) {
    const std::unique_ptr<ceres::Problem> problem =
        Build(stage, fixed, {options_.edge_weight, options_.overlap_weight});
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.max_num_iterations = iterations;
    solver.num_threads = options_.threads;
    solver.function_tolerance = 1e-7;
    solver.parameter_tolerance = 1e-9;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, problem.get(), &summary);
    UpdateSigmas(stage);
  }

  void UpdateSigmas(const Stage& stage) {
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      const Pose pose = blocks_[i].ToPose();
      std::vector<double> distances;
      for (const SidePoint& point : sensors_[i].view->side_points) {
        if (!OnItsSide(i, point, pose, stage)) continue;
        const Eigen::Vector3d p = pose * Corrected(i, point.p);
        distances.push_back((structure_.SideOfLabel(point.label).ClosestPoint(p) - p).norm());
      }
      if (!Holds(i)) continue;
      constexpr double kMedianToSigma = 1.4826;
      sigma_[i] = std::max(kMinResidualSigma, kMedianToSigma * MedianOf(distances));
    }
  }

  /// Mean robust cost of the points that no solution has seen.
  double HeldOutCost(std::size_t i, const Pose& pose, double offset) const {
    const auto corrected = [&](const Eigen::Vector3d& p) -> Eigen::Vector3d {
      return p * (1 + offset / p.z());
    };
    double sum = 0;
    int count = 0;
    if (Holds(i)) {
      for (const SidePoint& point : sensors_[i].view->side_points) {
        if (!point.held_out) continue;
        const Eigen::Vector3d p = pose * corrected(point.p);
        sum += RobustCost((structure_.SideOfLabel(point.label).ClosestPoint(p) - p).norm(),
                          kFaceScale);
        ++count;
      }
      for (const EdgePoint& edge : sensors_[i].view->edge_points) {
        if (!edge.held_out) continue;
        const Eigen::Vector3d p = pose * corrected(edge.p);
        EdgeLine line;
        const bool found = NearestEdge(structure_.SideOfLabel(edge.label), p,
                                       pose.linear() * edge.outward, 0.1, &line);
        sum += RobustCost(found ? line.direction.dot(p) - line.offset : 0.1, kLineScale);
        ++count;
      }
    } else {
      for (std::size_t other = 0; other < sensors_.size(); ++other) {
        if (other == i) continue;
        const Pose other_from_this = blocks_[other].ToPose().inverse() * pose;
        for (const int j : overlap_points_[i]) {
          const CloudPoint& from = sensors_[i].view->cloud[static_cast<std::size_t>(j)];
          if (!from.held_out) continue;
          const Eigen::Vector3d p = other_from_this * corrected(from.p);
          const int nearest = sensors_[other].view->Nearest(p, 0.1);
          if (nearest < 0) continue;
          const CloudPoint& to = sensors_[other].view->cloud[static_cast<std::size_t>(nearest)];
          if ((other_from_this.linear() * from.normal).dot(to.normal) < 0.7) continue;
          sum += RobustCost(to.normal.dot(p - Corrected(other, to.p)), kFaceScale);
          ++count;
        }
      }
    }
    return count > 0 ? sum / count : 0;
  }

  /// How much less n residuals of a sensor say than n independent ones would: >= 1.
  double DesignEffect(std::size_t i, const Stage& stage) const {
    const Pose pose = blocks_[i].ToPose();
    std::map<std::pair<int, int>, std::pair<double, int>> blocks;  // by label and image block
    double squares = 0;
    int count = 0;
    for (const SidePoint& point : sensors_[i].view->side_points) {
      if (!OnItsSide(i, point, pose, stage)) continue;
      const Side& side = structure_.SideOfLabel(point.label);
      const double r = side.normal.dot(pose * Corrected(i, point.p) - side.centre);
      auto& sum = blocks[{point.label, point.block}];
      sum.first += r;
      ++sum.second;
      squares += r * r;
      ++count;
    }
    if (count < 2 || !(squares > 0)) return 1;
    double of_sums = 0;
    for (const auto& [key, sum] : blocks) of_sums += sum.first * sum.first;
    return std::max(1.0, of_sums / squares);
  }

  /// H^-1 M H^-1 with H = J^T W J of the solution's weights W and M = J^T W^2 J, what unit variance
  /// of every whitened residual makes of it: weights that make up for correlation are no additional
  /// measurements.
  std::vector<Matrix6d> Covariances() {
    const Stage stage = StageOf(options_.outer_iterations);
    const auto squared = [](double w) { return w * w; };
    const Weights weights{options_.edge_weight, options_.overlap_weight};
    const std::unique_ptr<ceres::Problem> problem = Build(stage, {}, weights);
    const std::unique_ptr<ceres::Problem> meat_problem =
        Build(stage, {}, {squared(weights.edge), squared(weights.overlap)});
    std::vector<double*> blocks;
    for (PoseBlock& block : blocks_) blocks.push_back(block.values);
    if (options_.depth_offset_sigma_m > 0) {
      for (double& offset : offset_) blocks.push_back(&offset);
    }
    std::vector<Matrix6d> result(sensors_.size(), Matrix6d::Identity());
    ceres::Covariance::Options covariance_options;
    covariance_options.algorithm_type = ceres::SPARSE_QR;
    covariance_options.num_threads = options_.threads;
    ceres::Covariance covariance(covariance_options);
    const std::vector<const double*> wanted(blocks.begin(), blocks.end());
    if (!covariance.Compute(wanted, problem.get())) return result;
    const auto size =
        static_cast<Eigen::Index>(6 * sensors_.size() + blocks.size() - sensors_.size());
    Eigen::MatrixXd inverse(size, size);
    if (!covariance.GetCovarianceMatrixInTangentSpace(wanted, inverse.data())) return result;

    ceres::Problem::EvaluateOptions evaluation;
    evaluation.parameter_blocks = blocks;
    evaluation.num_threads = options_.threads;
    ceres::CRSMatrix jacobian;
    if (!meat_problem->Evaluate(evaluation, nullptr, nullptr, nullptr, &jacobian)) return result;
    Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(size, size);
    for (int row = 0; row < jacobian.num_rows; ++row) {
      const auto begin = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row)]);
      const auto end = static_cast<std::size_t>(jacobian.rows[static_cast<std::size_t>(row) + 1]);
      for (std::size_t i = begin; i < end; ++i) {
        for (std::size_t j = begin; j < end; ++j) {
          meat(jacobian.cols[i], jacobian.cols[j]) += jacobian.values[i] * jacobian.values[j];
        }
      }
    }
    const Eigen::MatrixXd sandwich = inverse * meat * inverse;
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      const Matrix6d block =
          sandwich.block<6, 6>(static_cast<Eigen::Index>(6 * i), static_cast<Eigen::Index>(6 * i));
      result[i] = DesignEffect(i, stage) * (block + block.transpose()) / 2;
    }
    return result;
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
  std::vector<PoseBlock> blocks_;
  std::vector<double> sigma_;   // m, per sensor
  std::vector<double> offset_;  // m, added to each sensor's depths
  std::vector<std::vector<int>> overlap_points_;
  LeftPoseManifold manifold_;
  std::unique_ptr<ceres::LossFunction> loss_ = std::make_unique<ceres::CauchyLoss>(2.0);
};

}  // namespace

RefineResult Refine(const Structure& structure, const std::vector<RefineSensor>& sensors,
                    const RefineOptions& options) {
  if (sensors.empty()) return {};
  return JointProblem(structure, sensors, options).Run();
}

}  // namespace volalign
