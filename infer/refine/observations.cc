#include "infer/refine/observations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "core/base/statistics.h"
#include "infer/refine/association.h"
#include "infer/refine/residuals.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

constexpr double kSideGate = 2 * kRoughPose;  // m, of a labelled point from its side
constexpr std::size_t kFewest = 3;            // points of an observation on a face
/// Errors of neighbouring pixels are alike over a pixel or two: a mean of n has the variance of n /
/// 2.
constexpr double kPixelsPerError = 2;

// The robust fit. Errors that neighbours share are no outliers, though they reach 2.5 robust
// spreads. With that limit, smooth errors of rendered D415s were estimated at 77 % of their size,
// and their positions were 12.2 mm off in the median, not 11.8.
constexpr int kRobustIterations = 8;
constexpr double kRobustPose = 1;  // m and rad, prior of the pose
constexpr double kLeastFaceScale = 2 * kDepthStep;
constexpr double kOutlier = 3.5;  // spreads
constexpr double kWidening = 4;   // of what an outlier's square exceeds the limit's by

/// Leaves out points whose depth may belong to a neighbouring ray, if the others are enough.
void LeaveOutLateral(std::vector<const SidePoint*>* points) {
  const auto lateral =
      std::stable_partition(points->begin(), points->end(),
                            [](const SidePoint* point) { return point->lateral_sigma_rad == 0; });
  if (static_cast<std::size_t>(lateral - points->begin()) >= kFewest)
    points->erase(lateral, points->end());
}

/// One image block's points on one side, without those that lie apart from the others.
FaceObservation FaceOf(const Structure& nominal, const Structure& built, const FrameState& sensor,
                       int label, const DepthErrorModel& errors,
                       const std::vector<const SidePoint*>& points) {
  const Side& side = built.SideOfLabel(label);
  std::vector<double> distances;
  distances.reserve(points.size());
  for (const SidePoint* point : points)
    distances.push_back(side.normal.dot(sensor.InStructure(point->p) - side.centre));
  const double middle = Quantile(distances, 0.5);
  std::vector<double> deviations;
  deviations.reserve(distances.size());
  for (const double d : distances) deviations.push_back(std::abs(d - middle));
  const double spread = kMadToSigma * Quantile(deviations, 0.5) + kDepthStep;
  FaceObservation face;
  face.label = label;
  face.p.setZero();
  double squares = 0, weights = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (std::abs(distances[k] - middle) > kClearly * spread) continue;
    // A pixel on which several frames disagree has less weight.
    const double weight = 1 / (1 + Square(points[k]->sigma / kDepthStep));
    face.p += weight * points[k]->p;
    face.lateral_sigma_rad += weight * points[k]->lateral_sigma_rad;
    squares += Square(weight * (distances[k] - middle));
    weights += weight;
  }
  face.p /= weights;
  face.lateral_sigma_rad /= weights;
  face.variance = kPixelsPerError * squares / weights / weights;
  face.by_errors.head<kFrameErrors>() = FrameErrorsAt(
      errors, face.p, sensor.structure_from_sensor.linear().transpose() * side.normal);
  const Side& nominal_side = nominal.SideOfLabel(label);
  const Eigen::Vector3d q = sensor.InStructure(face.p);
  face.bulge = side.BulgeAt(q);
  face.by_errors[kMultipath] =
      std::min(0.0, SeamDistance(nominal, nominal_side, q) / errors.seam_reach_m - 1);
  face.by_errors[kDiffuseMultipath] = DiffuseMultipathShare(
      nominal, nominal_side, q, sensor.structure_from_sensor.translation(), errors.bounce_reach_m);
  face.by_errors[kGain] = face.p.z();
  return face;
}

/// Silhouette points of one image block along one edge.
EdgeObservation EdgeOf(int label, int edge_index, int axis,
                       const std::vector<const EdgePoint*>& points) {
  EdgeObservation edge;
  edge.label = label;
  edge.edge = edge_index;
  edge.axis = axis;
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
  return edge;
}

/// Robust standard deviation of a part of `sizes`.
double Spread(const Eigen::VectorXd& sizes, std::size_t first, std::size_t count) {
  return kMadToSigma *
         Quantile(std::vector<double>(sizes.data() + first, sizes.data() + first + count), 0.5);
}

/// Size of one unit of each residual: 1 m of a face, 1 px of a silhouette.
Eigen::VectorXd Units(const FrameObservations& observed) {
  Eigen::VectorXd units = Eigen::VectorXd::Ones(
      static_cast<Eigen::Index>(observed.faces.size() + observed.edges.size()));
  for (std::size_t e = 0; e < observed.edges.size(); ++e)
    units[static_cast<Eigen::Index>(observed.faces.size() + e)] = observed.edges[e].pixel;
  return units;
}

/// Residuals of a sensor's observations, m, after least squares of its own parameters, reweighted
/// by Cauchy's function.
Eigen::VectorXd RobustResiduals(const BuildModel& model, const FrameObservations& observed,
                                const FrameParameters& parameters, const Priors& priors) {
  Eigen::VectorXd r;
  Eigen::MatrixXd over_blocks;
  Residuals(model, observed, parameters, &r, &over_blocks);
  const Eigen::MatrixXd j = FrameColumns::InTangentSpace(over_blocks, parameters.pose);
  DepthErrorModel errors = observed.noise.depth;
  errors.seam_m *= 2;
  Eigen::VectorXd prior(j.cols());
  prior << Eigen::VectorXd::Constant(6, kRobustPose),
      SharedPriorSigmas(priors, errors, model.size()).unaryExpr(&Positive);
  const Eigen::VectorXd units = Units(observed);
  const std::size_t faces = observed.faces.size(), edges = observed.edges.size();
  Eigen::VectorXd left = r;
  for (int iteration = 0; iteration < kRobustIterations; ++iteration) {
    const Eigen::VectorXd sizes = left.cwiseAbs().cwiseQuotient(units);
    const double face = std::max(kLeastFaceScale, Spread(sizes, 0, faces));
    const double edge = std::max(StepSigma(), Spread(sizes, faces, edges));
    Eigen::VectorXd weights(r.size());
    for (Eigen::Index k = 0; k < r.size(); ++k) {
      const double sigma = units[k] * (k < static_cast<Eigen::Index>(faces) ? face : edge);
      weights[k] = 1 / (Square(sigma) + Square(left[k]));
    }
    Eigen::MatrixXd h = j.transpose() * weights.asDiagonal() * j;
    h.diagonal() += prior.cwiseAbs2().cwiseInverse();
    left = r - j * h.ldlt().solve(j.transpose() * (weights.asDiagonal() * r));
  }
  return left;
}

}  // namespace

void GatherObservations(const Structure& nominal, const State& state, std::size_t frame,
                        const SensorPoints& points, FrameObservations* observed) {
  const Structure& built = state.Built(frame);
  const FrameState sensor = state.Frame(frame);
  std::map<std::pair<int, int>, std::vector<const SidePoint*>> faces;  // by label and block
  for (const SidePoint& point : points.side_points) {
    if (LiesOnItsSide(built, sensor, point, kSideGate))
      faces[{point.label, point.block}].push_back(&point);
  }
  // By label, edge, block and axis.
  std::map<std::array<int, 4>, std::vector<const EdgePoint*>> lines;
  for (const EdgePoint& edge : points.edge_points) {
    const int border = EdgeUnder(built, sensor, edge, kSideGate);
    if (border >= 0) lines[{edge.label, border, edge.block, edge.axis}].push_back(&edge);
  }
  observed->lens = points.lens;
  observed->faces.clear();
  for (auto& [key, of] : faces) {
    LeaveOutLateral(&of);
    if (of.size() >= kFewest)
      observed->faces.push_back(
          FaceOf(nominal, built, sensor, key.first, observed->noise.depth, of));
  }
  for (FaceObservation& face : observed->faces) face.by_lens = points.RayByLensAt(face.p);
  observed->edges.clear();
  for (const auto& [key, of] : lines) observed->edges.push_back(EdgeOf(key[0], key[1], key[3], of));
  for (EdgeObservation& edge : observed->edges) edge.by_lens = points.RayByLensAt(edge.p);
}

void WidenOutliers(const BuildModel& model, const FrameParameters& parameters, const Priors& priors,
                   FrameObservations* observed) {
  const std::size_t faces = observed->faces.size();
  Eigen::VectorXd sizes = RobustResiduals(model, *observed, parameters, priors).cwiseAbs();
  sizes = sizes.cwiseQuotient(Units(*observed)).eval();
  const auto widen = [&](std::size_t first, std::size_t count, double least_spread,
                         const auto& variance) {
    const double limit = kOutlier * std::max(least_spread, Spread(sizes, first, count));
    for (std::size_t k = 0; k < count; ++k) {
      const double size = sizes[static_cast<Eigen::Index>(first + k)];
      if (size > limit) *variance(k) += kWidening * (size * size - limit * limit);
    }
  };
  widen(0, faces, kDepthStep, [&](std::size_t k) { return &observed->faces[k].variance; });
  widen(faces, observed->edges.size(), StepSigma(),
        [&](std::size_t k) { return &observed->edges[k].variance; });
}

}  // namespace volalign::refine_internal
