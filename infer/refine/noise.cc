#include "infer/refine/noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/base/lists.h"
#include "core/geometry/factor.h"
#include "infer/lens/likelihood.h"
#include "infer/lens/sensor_kind.h"
#include "infer/refine/residuals.h"

namespace volalign::refine_internal {

namespace {

// The covariance.
constexpr double kReferenceDepth = 2;     // m, that NoiseModel::warp is for
constexpr double kEdgeLength = 0.15;      // rad, correlation of silhouette errors along an edge
constexpr double kEdgeCommon = 0.6;       // px, of the correlated part
constexpr double kLineTolerance = 0.004;  // m, an edge of a box is not a straight line
/// A depth error moves a side that is seen at grazing incidence little, but there errors across the
/// ray, of a pixel or less, count instead.
constexpr double kLeastLever = 0.2;
constexpr double kLateral = 0.0003;   // rad, under a tenth of a pixel
constexpr double kLeastSigma = 3e-4;  // m: 1 mm steps

// The fit. Warps of real sensors are 3-6 mm for time of flight, 8-20 mm for stereo: a log-normal
// prior of 5 mm and a factor of e^0.8. Free of it, a warp can explain a tilt. (A prior of 12.6 mm
// for stereo takes the worst of 43 sensors of an independent simulator from 7.7 to 9.0 mm.)
constexpr double kUsualWarp = 0.005, kWarpSpread = 0.8;  // m, of the logarithm
constexpr double kUsualStereoWarp = 0.0126;  // m, where nothing is fitted: the middle of 8-20 mm
constexpr double kLeastWarp = 3e-4, kMostWarp = 0.02;  // m
constexpr int kWarpSteps = 8;
constexpr std::array<double, 3> kWarpLengths = {0.05, 0.1, 0.18};     // rad
constexpr std::array<double, 3> kMultipaths = {0.001, 0.005, 0.012};  // m
constexpr double kUsualMultipath = 0.012;                             // m, while the warp is sought
constexpr double kLeastEdge = 0.25, kMostEdge = 8, kEdgeSpread = 1;   // of NoiseModel::edge
constexpr int kEdgeSteps = 6;
constexpr std::size_t kMostObservations = 110;  // of each kind: enough for three numbers
constexpr Eigen::Index kFewestFaces = 12, kFewestEdges = 8;  // that tell more than the defaults

Eigen::Vector2d Bearing(const Eigen::Vector3d& p) { return p.head<2>() / p.z(); }

/// How far a depth error of 1 m moves each observation along its side's normal, times the growth of
/// the error with depth.
Eigen::VectorXd WarpLever(const BuildModel& model, const Pose& pose,
                          const FrameObservations& observed) {
  Eigen::VectorXd lever(static_cast<Eigen::Index>(observed.faces.size()));
  for (std::size_t i = 0; i < observed.faces.size(); ++i) {
    const FaceObservation& face = observed.faces[i];
    const Eigen::Vector3d& normal = model.structure().SideOfLabel(face.label).normal;
    const double along = normal.dot(pose.linear() * face.p) / face.p.z();
    lever[static_cast<Eigen::Index>(i)] =
        -std::hypot(along, kLeastLever) * face.p.z() / kReferenceDepth;
  }
  return lever;
}

Eigen::MatrixXd WarpCorrelation(const FrameObservations& observed, const Eigen::VectorXd& lever,
                                double length) {
  const auto n = static_cast<Eigen::Index>(observed.faces.size());
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector2d at = Bearing(observed.faces[static_cast<std::size_t>(i)].p);
    for (Eigen::Index j = 0; j <= i; ++j) {
      const Eigen::Vector2d other = Bearing(observed.faces[static_cast<std::size_t>(j)].p);
      covariance(i, j) = covariance(j, i) =
          lever[i] * lever[j] * Correlation((at - other).norm(), length);
    }
  }
  return covariance;
}

Eigen::VectorXd FaceVariances(const BuildModel& model, const Pose& pose,
                              const FrameObservations& observed) {
  Eigen::VectorXd variances(static_cast<Eigen::Index>(observed.faces.size()));
  for (std::size_t i = 0; i < observed.faces.size(); ++i) {
    const FaceObservation& face = observed.faces[i];
    const double cosine =
        model.structure().SideOfLabel(face.label).normal.dot(pose.linear() * face.p.normalized());
    const double lateral = kLateral * face.p.z();
    variances[static_cast<Eigen::Index>(i)] =
        face.variance + (1 - cosine * cosine) * lateral * lateral + kLeastSigma * kLeastSigma;
  }
  return variances;
}

/// Of the edges, for scale 1.
Eigen::MatrixXd EdgeCovariance(const FrameObservations& observed) {
  const double tolerance = std::hypot(kLineTolerance, observed.noise.line);
  const auto n = static_cast<Eigen::Index>(observed.edges.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const EdgeObservation& a = observed.edges[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j <= i; ++j) {
      const EdgeObservation& b = observed.edges[static_cast<std::size_t>(j)];
      if (a.label != b.label || a.edge != b.edge) continue;
      const double correlation = Correlation((Bearing(a.p) - Bearing(b.p)).norm(), kEdgeLength);
      covariance(i, j) = covariance(j, i) =
          a.pixel * b.pixel * kEdgeCommon * kEdgeCommon * correlation + tolerance * tolerance;
    }
    covariance(i, i) += a.pixel * a.pixel * a.variance;
  }
  return covariance;
}

/// Lower Cholesky factor; filled with NaN where there is none.
Eigen::MatrixXd LowerRoot(const Eigen::MatrixXd& covariance) {
  if (const std::optional<CholeskyFactor> factor = Factor(covariance)) return factor->matrixL();
  return Eigen::MatrixXd::Constant(covariance.rows(), covariance.cols(),
                                   std::numeric_limits<double>::quiet_NaN());
}

/// At most kMostObservations of each kind, evenly taken.
FrameObservations Sample(const FrameObservations& observed) {
  FrameObservations sample;
  sample.noise = observed.noise;
  sample.faces = Thinned(observed.faces, kMostObservations);
  sample.edges = Thinned(observed.edges, kMostObservations);
  return sample;
}

/// Residuals of one kind of observation, linear in the parameters.
struct Linearised {
  Eigen::VectorXd residuals;  // m, without what the parameters beside the pose took away
  Eigen::MatrixXd by_pose;    // derivatives in the pose's tangent space
  Eigen::MatrixXd shared;     // derivatives by the rest, each times its prior sigma
  Eigen::VectorXd seam;       // derivatives by the multipath error, which is none of `shared`

  Linearised Rows(Eigen::Index first, Eigen::Index count) const {
    return {residuals.segment(first, count), by_pose.middleRows(first, count),
            shared.middleRows(first, count), seam.segment(first, count)};
  }
};

Linearised Linearise(const BuildModel& model, const FrameObservations& observed,
                     const FrameParameters& parameters, const Priors& priors) {
  Linearised linear;
  Eigen::MatrixXd jacobian;
  Residuals(model, observed, parameters, &linear.residuals, &jacobian);
  linear.by_pose =
      FrameColumns::InTangentSpace(jacobian.leftCols<FrameColumns::kOffset>(), parameters.pose);
  const auto boxes = static_cast<int>(model.structure().boxes().size());
  const Eigen::VectorXd sigmas = SharedPriorSigmas(priors, 0, boxes);
  const Eigen::MatrixXd known = jacobian.rightCols(sigmas.size());
  linear.residuals -= known * SharedValues(parameters, boxes);
  linear.shared = known * sigmas.asDiagonal();
  linear.seam = known.col(FrameColumns::kNuisance + kMultipath - FrameColumns::kOffset);
  return linear;
}

/// Size and correlation length of the smooth depth error, then the multipath error.
void FitFaceNoise(const BuildModel& model, const Pose& pose, const FrameObservations& sample,
                  const Linearised& faces, NoiseModel* noise) {
  const Eigen::VectorXd lever = WarpLever(model, pose, sample);
  Eigen::MatrixXd rest = faces.shared * faces.shared.transpose();
  rest.diagonal() += FaceVariances(model, pose, sample);
  const Eigen::MatrixXd multipath = faces.seam * faces.seam.transpose();
  double least = std::numeric_limits<double>::infinity();
  for (const double length : kWarpLengths) {
    const Eigen::MatrixXd correlation = WarpCorrelation(sample, lever, length);
    double warp = 0;
    const double cost = MinimiseOverLog(
        kLeastWarp, kMostWarp, kWarpSteps,
        [&](double sigma) {
          const double unusual = std::log(sigma / kUsualWarp) / kWarpSpread;
          return RestrictedCost(sigma * sigma * correlation + rest +
                                    kUsualMultipath * kUsualMultipath * multipath,
                                faces.residuals, faces.by_pose) +
                 0.5 * unusual * unusual;
        },
        &warp);
    if (cost < least) {
      least = cost;
      noise->warp = warp;
      noise->warp_length = length;
    }
  }
  const Eigen::MatrixXd others =
      noise->warp * noise->warp * WarpCorrelation(sample, lever, noise->warp_length) + rest;
  least = std::numeric_limits<double>::infinity();
  for (const double sigma : kMultipaths) {
    const double cost =
        RestrictedCost(others + sigma * sigma * multipath, faces.residuals, faces.by_pose);
    if (cost < least) {
      least = cost;
      noise->multipath = sigma;
    }
  }
}

/// Scale of the silhouettes' errors.
void FitEdgeNoise(const FrameObservations& sample, const Linearised& edges, NoiseModel* noise) {
  const Eigen::MatrixXd rest = edges.shared * edges.shared.transpose();
  const Eigen::MatrixXd own = EdgeCovariance(sample);
  MinimiseOverLog(
      kLeastEdge, kMostEdge, kEdgeSteps,
      [&](double scale) {
        const double unusual = std::log(scale) / kEdgeSpread;
        return RestrictedCost(scale * scale * own + rest, edges.residuals, edges.by_pose) +
               0.5 * unusual * unusual;
      },
      &noise->edge);
}

}  // namespace

NoiseModel UsualNoise(const std::string& sensor) {
  NoiseModel noise;
  noise.warp = kUsualWarp;
  if (MeasuresBy(DepthPrinciple::kStereo, sensor)) noise.warp = kUsualStereoWarp;
  return noise;
}

void SetCovariance(const BuildModel& model, const Pose& pose, FrameObservations* observed) {
  const NoiseModel& noise = observed->noise;
  const Eigen::VectorXd lever = WarpLever(model, pose, *observed);
  Eigen::MatrixXd faces =
      noise.warp * noise.warp * WarpCorrelation(*observed, lever, noise.warp_length);
  faces.diagonal() += FaceVariances(model, pose, *observed);
  observed->face_root = LowerRoot(faces);
  const Eigen::MatrixXd edges = noise.edge * noise.edge * EdgeCovariance(*observed);
  observed->edge_root = LowerRoot(edges);
}

void FitNoise(const BuildModel& model, const FrameParameters& parameters, const Priors& priors,
              FrameObservations* observed) {
  const FrameObservations sample = Sample(*observed);
  const Linearised all = Linearise(model, sample, parameters, priors);
  const auto faces = static_cast<Eigen::Index>(sample.faces.size());
  const auto edges = static_cast<Eigen::Index>(sample.edges.size());
  PoseBlock block;
  std::copy_n(parameters.pose, 7, block.values);
  const Pose pose = block.ToPose();
  if (faces > kFewestFaces) FitFaceNoise(model, pose, sample, all.Rows(0, faces), &observed->noise);
  if (edges > kFewestEdges) FitEdgeNoise(sample, all.Rows(faces, edges), &observed->noise);
  SetCovariance(model, pose, observed);
}

}  // namespace volalign::refine_internal
