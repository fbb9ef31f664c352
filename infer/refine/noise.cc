#include "infer/refine/noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/base/lists.h"
#include "core/geometry/factor.h"
#include "infer/lens/likelihood.h"
#include "infer/refine/residuals.h"
#include "infer/view/alike.h"

namespace volalign::refine_internal {

namespace {

// The covariance.
constexpr double kEdgeLength = 0.15;      // rad, correlation of silhouette errors along an edge
constexpr double kEdgeCommon = 0.6;       // px, of the correlated part
constexpr double kLineTolerance = 0.004;  // m, an edge of a box is not a straight line

// The fit.
constexpr std::array<double, 3> kSeams = {0.1, 0.4, 1};  // of the kind's
constexpr double kLeastEdge = 0.25, kEdgeSpread = 1;     // of NoiseModel::edge
constexpr std::size_t kMostObservations = 110;           // of each kind: enough for three numbers
constexpr Eigen::Index kFewestToFit = 12;  // of each kind: enough to improve on the defaults

Eigen::Vector2d Bearing(const Eigen::Vector3d& p) { return p.head<2>() / p.z(); }

SmoothMovement MovementOf(const BuildModel& model, const Pose& pose,
                          const FrameObservations& observed) {
  const auto n = static_cast<Eigen::Index>(observed.faces.size());
  SmoothMovement movement{Eigen::MatrixX2d(n, 2), Eigen::VectorXd(n)};
  for (Eigen::Index i = 0; i < n; ++i) {
    const FaceObservation& face = observed.faces[static_cast<std::size_t>(i)];
    const Eigen::Vector3d& normal = model.structure().SideOfLabel(face.label).normal;
    movement.bearings.row(i) = Bearing(face.p);
    movement.levers[i] =
        SmoothMovement::Lever(observed.noise.depth, face.p, pose.linear().transpose() * normal);
  }
  return movement;
}

Eigen::VectorXd FaceVariances(const BuildModel& model, const Pose& pose,
                              const FrameObservations& observed) {
  Eigen::VectorXd variances(static_cast<Eigen::Index>(observed.faces.size()));
  for (std::size_t i = 0; i < observed.faces.size(); ++i) {
    const FaceObservation& face = observed.faces[i];
    const double cosine =
        model.structure().SideOfLabel(face.label).normal.dot(pose.linear() * face.p.normalized());
    const double lateral =
        std::hypot(observed.noise.depth.lateral_rad, face.lateral_sigma_rad) * face.p.z();
    variances[static_cast<Eigen::Index>(i)] = face.variance +
                                              (1 - cosine * cosine) * lateral * lateral +
                                              Square(StepSigma() * kDepthStep);
  }
  return variances;
}

/// Covariance of the edges, m^2: `own` for scale 1, and `common`, the part that the points of an
/// edge share, per px^2.
struct EdgeCovariance {
  explicit EdgeCovariance(const FrameObservations& observed) {
    const double tolerance = std::hypot(kLineTolerance, observed.noise.line);
    const auto n = static_cast<Eigen::Index>(observed.edges.size());
    own = common = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const EdgeObservation& a = observed.edges[static_cast<std::size_t>(i)];
      for (Eigen::Index j = 0; j <= i; ++j) {
        const EdgeObservation& b = observed.edges[static_cast<std::size_t>(j)];
        if (a.label != b.label || a.edge != b.edge) continue;
        const double correlation = Correlation((Bearing(a.p) - Bearing(b.p)).norm(), kEdgeLength);
        common(i, j) = common(j, i) = a.pixel * b.pixel * correlation;
        own(i, j) = own(j, i) = tolerance * tolerance;
      }
      own(i, i) += a.pixel * a.pixel * a.variance;
    }
  }
  /// The common error is no smaller than the rounding to a pixel.
  Eigen::MatrixXd At(double scale) const {
    return scale * scale * own + Square(std::max(scale * kEdgeCommon, StepSigma())) * common;
  }
  Eigen::MatrixXd own, common;
};

/// Lower Cholesky factor; filled with NaN where there is none.
Eigen::MatrixXd LowerRoot(const Eigen::MatrixXd& covariance) {
  if (const std::optional<CholeskyFactor> factor = Factor(covariance)) return factor->matrixL();
  return Eigen::MatrixXd::Constant(covariance.rows(), covariance.cols(),
                                   std::numeric_limits<double>::quiet_NaN());
}

/// At most kMostObservations of each kind, evenly spaced.
FrameObservations Sample(const FrameObservations& observed) {
  FrameObservations sample;
  sample.noise = observed.noise;
  sample.faces = EvenSubset(observed.faces, kMostObservations);
  sample.edges = EvenSubset(observed.edges, kMostObservations);
  return sample;
}

/// Residuals of one kind of observation, linear in the parameters.
struct Linearised {
  Eigen::VectorXd residuals;  // m, before the parameters beside the pose reduced them
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
  DepthErrorModel errors = observed.noise.depth;
  errors.seam_m = 0;
  const Eigen::VectorXd sigmas = SharedPriorSigmas(priors, errors, model.size());
  const Eigen::MatrixXd known = jacobian.rightCols(sigmas.size());
  linear.residuals -= known * SharedValues(parameters, model.size());
  linear.shared = known * sigmas.asDiagonal();
  linear.seam = known.col(FrameColumns::kErrors + kMultipath - FrameColumns::kOffset);
  return linear;
}

/// Fits the size and correlation length of the smooth depth error, then the size of that in
/// corners.
DepthErrorModel FitErrors(const BuildModel& model, const Pose& pose,
                          const FrameObservations& sample, const Linearised& faces,
                          const DepthErrorModel& usual) {
  DepthErrorModel fitted = usual;
  const SmoothMovement movement = MovementOf(model, pose, sample);
  Eigen::MatrixXd rest = faces.shared * faces.shared.transpose();
  rest.diagonal() += FaceVariances(model, pose, sample);
  const Eigen::MatrixXd seam = faces.seam * faces.seam.transpose();
  FitSmoothError(movement, rest + Square(usual.seam_m) * seam, faces.residuals, faces.by_pose,
                 &fitted);
  const Eigen::MatrixXd others =
      Square(fitted.smooth_m) * movement.Covariance(fitted.smooth_rad) + rest;
  double least = std::numeric_limits<double>::infinity();
  for (const double share : kSeams) {
    const double sigma = share * usual.seam_m;
    const double cost =
        RestrictedCost(others + Square(sigma) * seam, faces.residuals, faces.by_pose);
    if (cost < least) {
      least = cost;
      fitted.seam_m = sigma;
    }
  }
  return fitted;
}

/// Fits the scale of the silhouettes' errors.
void FitEdgeNoise(const FrameObservations& sample, const Linearised& edges, NoiseModel* noise) {
  const Eigen::MatrixXd rest = edges.shared * edges.shared.transpose();
  const EdgeCovariance covariance(sample);
  noise->edge = MinimiseOverLog(kLeastEdge, 1 / kLeastEdge, [&](double scale) {
    const double unusual = std::log(scale) / kEdgeSpread;
    return RestrictedCost(covariance.At(scale) + rest, edges.residuals, edges.by_pose) +
           0.5 * unusual * unusual;
  });
}

}  // namespace

NoiseModel UsualNoise(const std::string& sensor) {
  NoiseModel noise;
  noise.depth = PriorErrorsOf(sensor);
  return noise;
}

void SetCovariance(const BuildModel& model, const Pose& pose, FrameObservations* observed) {
  const NoiseModel& noise = observed->noise;
  Eigen::MatrixXd faces = Square(noise.depth.smooth_m) *
                          MovementOf(model, pose, *observed).Covariance(noise.depth.smooth_rad);
  faces.diagonal() += FaceVariances(model, pose, *observed);
  observed->face_root = LowerRoot(faces);
  observed->edge_root = LowerRoot(EdgeCovariance(*observed).At(noise.edge));
}

void FitNoise(const BuildModel& model, const DepthErrorModel& usual,
              const FrameParameters& parameters, const Priors& priors,
              FrameObservations* observed) {
  const FrameObservations sample = Sample(*observed);
  const Linearised all = Linearise(model, sample, parameters, priors);
  const auto faces = static_cast<Eigen::Index>(sample.faces.size());
  const auto edges = static_cast<Eigen::Index>(sample.edges.size());
  const Pose pose = PoseBlock::ToPose(parameters.pose);
  if (faces > kFewestToFit)
    observed->noise.depth = FitErrors(model, pose, sample, all.Rows(0, faces), usual);
  if (edges > kFewestToFit) FitEdgeNoise(sample, all.Rows(faces, edges), &observed->noise);
  SetCovariance(model, pose, observed);
}

}  // namespace volalign::refine_internal
