#include "infer/refine/model.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "infer/refine/costs.h"

namespace volalign::refine_internal {

namespace {

constexpr double kReferenceDepth = 2;     // m, that NoiseModel::warp is for
constexpr double kEdgeLength = 0.15;      // rad, correlation of silhouette errors along an edge
constexpr double kEdgeCommon = 0.6;       // px, of the correlated part
constexpr double kLineTolerance = 0.004;  // m, an edge of a box is not a straight line
/// A depth error moves a side that is seen at grazing incidence little, but there errors across the
/// ray, of a pixel or less, count instead.
constexpr double kLeastGain = 0.2;
constexpr double kLateral = 0.0003;   // rad, under a tenth of a pixel
constexpr double kLeastSigma = 3e-4;  // m: 1 mm steps

Eigen::Vector3d Along(const Side& side, int edge) {
  return (edge % 2 ? -1.0 : 1.0) * (edge < 2 ? side.axis_u : side.axis_v);
}

/// Matern 3/2: smooth, but not so smooth that a field could be foretold from far away.
double Correlation(double distance, double length) {
  const double x = 1.7320508 * distance / length;
  return (1 + x) * std::exp(-x);
}

Eigen::Vector2d Bearing(const Eigen::Vector3d& p) { return p.head<2>() / p.z(); }

Eigen::Vector3d VerticalCross(const Eigen::Vector3d& v) { return {v.z(), 0, -v.x()}; }

/// How far a depth error of 1 m moves each observation along its side's normal, times the growth of
/// the error with depth.
Eigen::VectorXd WarpGain(const BuildModel& model, const Pose& pose,
                         const SensorEvidence& evidence) {
  Eigen::VectorXd gain(static_cast<Eigen::Index>(evidence.faces.size()));
  for (std::size_t i = 0; i < evidence.faces.size(); ++i) {
    const FaceObservation& face = evidence.faces[i];
    const Eigen::Vector3d& normal = model.structure().SideOfLabel(face.label).normal;
    const double along = normal.dot(pose.linear() * face.p) / face.p.z();
    gain[static_cast<Eigen::Index>(i)] =
        -std::hypot(along, kLeastGain) * face.p.z() / kReferenceDepth;
  }
  return gain;
}

Eigen::MatrixXd WarpCorrelation(const SensorEvidence& evidence, const Eigen::VectorXd& gain,
                                double length) {
  const auto n = static_cast<Eigen::Index>(evidence.faces.size());
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector2d at = Bearing(evidence.faces[static_cast<std::size_t>(i)].p);
    for (Eigen::Index j = 0; j <= i; ++j) {
      const Eigen::Vector2d other = Bearing(evidence.faces[static_cast<std::size_t>(j)].p);
      covariance(i, j) = covariance(j, i) =
          gain[i] * gain[j] * Correlation((at - other).norm(), length);
    }
  }
  return covariance;
}

Eigen::VectorXd FaceVariances(const BuildModel& model, const Pose& pose,
                              const SensorEvidence& evidence) {
  Eigen::VectorXd variances(static_cast<Eigen::Index>(evidence.faces.size()));
  for (std::size_t i = 0; i < evidence.faces.size(); ++i) {
    const FaceObservation& face = evidence.faces[i];
    const double cosine =
        model.structure().SideOfLabel(face.label).normal.dot(pose.linear() * face.p.normalized());
    const double lateral = kLateral * face.p.z();
    variances[static_cast<Eigen::Index>(i)] =
        face.variance + (1 - cosine * cosine) * lateral * lateral + kLeastSigma * kLeastSigma;
  }
  return variances;
}

/// Of the edges, for scale 1.
Eigen::MatrixXd EdgeCovariance(const SensorEvidence& evidence) {
  const double tolerance = std::hypot(kLineTolerance, evidence.noise.line);
  const auto n = static_cast<Eigen::Index>(evidence.edges.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const EdgeObservation& a = evidence.edges[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j <= i; ++j) {
      const EdgeObservation& b = evidence.edges[static_cast<std::size_t>(j)];
      if (a.label != b.label || a.edge != b.edge) continue;
      const double correlation = Correlation((Bearing(a.p) - Bearing(b.p)).norm(), kEdgeLength);
      covariance(i, j) = covariance(j, i) =
          a.pixel * b.pixel * kEdgeCommon * kEdgeCommon * correlation + tolerance * tolerance;
    }
    covariance(i, i) += a.pixel * a.pixel * a.variance;
  }
  return covariance;
}

/// Negative logarithm of the restricted likelihood of residuals r under covariance C, when the
/// parameters of J are unknown.
double RestrictedCost(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& r,
                      const Eigen::MatrixXd& jacobian) {
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  if (root.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd y = root.matrixL().solve(r);
  const Eigen::MatrixXd a = root.matrixL().solve(jacobian);
  Eigen::MatrixXd information = a.transpose() * a;
  information.diagonal().array() += 1e-3 * (1 + information.diagonal().maxCoeff() * 1e-9);
  const Eigen::LLT<Eigen::MatrixXd> inner(information);
  const Eigen::VectorXd projected = inner.matrixL().solve(a.transpose() * y);
  double log_root = 0, log_inner = 0;
  for (Eigen::Index i = 0; i < covariance.rows(); ++i) log_root += std::log(root.matrixLLT()(i, i));
  for (Eigen::Index i = 0; i < information.rows(); ++i)
    log_inner += std::log(inner.matrixLLT()(i, i));
  return log_root + log_inner + 0.5 * (y.squaredNorm() - projected.squaredNorm());
}

/// Least value of a function over the logarithm of its argument: a grid, then a parabola.
template <class F>
double MinimiseOverLog(double low, double high, int steps, const F& f, double* best) {
  std::vector<double> values;
  const double ratio = std::pow(high / low, 1.0 / (steps - 1));
  int least = 0;
  for (int i = 0; i < steps; ++i) {
    values.push_back(f(low * std::pow(ratio, i)));
    if (values.back() < values[static_cast<std::size_t>(least)]) least = i;
  }
  double shift = 0;
  if (least > 0 && least + 1 < steps) {
    const double a = values[static_cast<std::size_t>(least - 1)],
                 b = values[static_cast<std::size_t>(least)],
                 c = values[static_cast<std::size_t>(least + 1)];
    const double bend = a - 2 * b + c;
    if (std::isfinite(bend) && bend > 0) shift = std::clamp(0.5 * (a - c) / bend, -0.5, 0.5);
  }
  *best = low * std::pow(ratio, least + shift);
  return values[static_cast<std::size_t>(least)];
}

}  // namespace

Pose BuildModel::Offset(const double* build, int box) const {
  const Eigen::Vector3d centre =
      structure_->boxes()[static_cast<std::size_t>(box)].structure_from_box.translation();
  const Eigen::Vector3d shift(build[X(box)], build[0] * (centre.y() - floor_), build[Z(box)]);
  Pose offset = Pose::Identity();
  offset.linear() = Eigen::AngleAxisd(build[Yaw(box)], Eigen::Vector3d::UnitY()).toRotationMatrix();
  offset.translation() = centre - offset.linear() * centre + shift;
  return offset;
}

Structure BuildModel::Built(const double* build) const {
  std::vector<Pose> offsets;
  for (int b = 0; b < static_cast<int>(structure_->boxes().size()); ++b)
    offsets.push_back(Offset(build, b));
  return structure_->Displaced(offsets, 1 + build[0]);
}

double SeamShare(const Structure& structure, const Side& side, const Eigen::Vector3d& q) {
  double nearest = kMultipathReach;
  if (std::abs(side.normal.y()) < 0.5)
    nearest = std::clamp(q.y() - structure.FloorHeight(), 0.0, nearest);
  constexpr double kRise = 0.02;  // m
  const double plane = side.normal.dot(side.centre);
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    if (static_cast<int>(b) == side.box) continue;
    const Box& box = structure.boxes()[b];
    const Eigen::Matrix3d box_from_structure = box.structure_from_box.linear().transpose();
    const Eigen::Vector3d half = 0.5 * box.size;
    const double reach = side.normal.dot(box.structure_from_box.translation()) +
                         (box_from_structure * side.normal).cwiseAbs().dot(half);
    if (reach < plane + kRise) continue;
    const Eigen::Vector3d d = box_from_structure * (q - box.structure_from_box.translation());
    nearest = std::min(nearest, (d.cwiseAbs() - half).cwiseMax(0.0).norm());
  }
  return 1 - nearest / kMultipathReach;
}

void Residuals(const BuildModel& model, const SensorEvidence& evidence,
               const SensorParameters& parameters, Eigen::VectorXd* residuals,
               Eigen::MatrixXd* jacobian) {
  const auto faces = static_cast<Eigen::Index>(evidence.faces.size());
  const auto edges = static_cast<Eigen::Index>(evidence.edges.size());
  constexpr Eigen::Index kOffsetColumn = 7, kNuisanceColumn = 8,
                         kBuildColumn = kNuisanceColumn + kNuisances;
  residuals->resize(faces + edges);
  if (jacobian) jacobian->setZero(faces + edges, kBuildColumn + model.size());
  const Structure& structure = model.structure();
  const Eigen::Quaterniond q(parameters.pose);
  const Eigen::Matrix3d rotation = q.normalized().toRotationMatrix();
  const Eigen::Map<const Eigen::Vector3d> t(parameters.pose + 4);
  const double growth = parameters.build[0];

  // A plane of a side, moved with its box: normal . (p - centre) = extent.
  struct MovedPlane {
    Eigen::Vector3d normal, nominal_centre, centre;
    double half, height;
    int box;
  };
  const auto moved = [&](const Side& side, const Eigen::Vector3d& direction, double extent) {
    const Box& box = structure.boxes()[static_cast<std::size_t>(side.box)];
    MovedPlane plane;
    plane.box = side.box;
    plane.nominal_centre = box.structure_from_box.translation();
    plane.height = plane.nominal_centre.y() - model.floor();
    plane.half = direction.dot(side.centre - plane.nominal_centre) + extent;
    plane.normal =
        Eigen::AngleAxisd(parameters.build[BuildModel::Yaw(side.box)], Eigen::Vector3d::UnitY()) *
        direction;
    plane.centre = plane.nominal_centre +
                   Eigen::Vector3d(parameters.build[BuildModel::X(side.box)], growth * plane.height,
                                   parameters.build[BuildModel::Z(side.box)]);
    return plane;
  };
  const auto distance = [&](const MovedPlane& plane, const Eigen::Vector3d& at) {
    return plane.normal.dot(at - plane.centre) - (1 + growth) * plane.half;
  };
  // Of `distance` of R p + t, p fixed.
  const auto differentiate = [&](const MovedPlane& plane, const Eigen::Vector3d& p,
                                 const Eigen::Vector3d& at) {
    Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(kBuildColumn + model.size());
    row.head<4>() = plane.normal.transpose() * RotatedPointJacobian(parameters.pose, p);
    row.segment<3>(4) = plane.normal.transpose();
    row[kBuildColumn] = -plane.normal.y() * plane.height - plane.half;
    row[kBuildColumn + BuildModel::X(plane.box)] = -plane.normal.x();
    row[kBuildColumn + BuildModel::Z(plane.box)] = -plane.normal.z();
    row[kBuildColumn + BuildModel::Yaw(plane.box)] =
        VerticalCross(plane.normal).dot(at - plane.centre);
    return row;
  };

  for (Eigen::Index i = 0; i < faces; ++i) {
    const FaceObservation& face = evidence.faces[static_cast<std::size_t>(i)];
    const Side& side = structure.SideOfLabel(face.label);
    const MovedPlane plane = moved(side, side.normal, 0);
    const Eigen::Vector3d ray = face.p / face.p.z();
    const double depth = face.p.z() * (1 + parameters.nuisance[kDepthGain]) + parameters.offset[0] -
                         parameters.nuisance[kMultipath] * face.multipath;
    const Eigen::Vector3d p = depth * ray, at = rotation * p + t;
    (*residuals)[i] = distance(plane, at);
    if (!jacobian) continue;
    jacobian->row(i) = differentiate(plane, p, at);
    const double along = plane.normal.dot(rotation * ray);
    (*jacobian)(i, kOffsetColumn) = along;
    (*jacobian)(i, kNuisanceColumn + kDepthGain) = along * face.p.z();
    (*jacobian)(i, kNuisanceColumn + kMultipath) = -along * face.multipath;
  }
  for (Eigen::Index e = 0; e < edges; ++e) {
    const EdgeObservation& edge = evidence.edges[static_cast<std::size_t>(e)];
    const Eigen::Index i = faces + e;
    const Side& side = structure.SideOfLabel(edge.label);
    const MovedPlane plane = moved(side, side.normal, 0);
    const MovedPlane line =
        moved(side, Along(side, edge.edge), edge.edge < 2 ? side.half_u : side.half_v);
    const Eigen::Vector3d ray = edge.p / edge.p.z();
    const Eigen::Vector3d v = rotation * ray, at = rotation * edge.p + t;
    // Along the ray to the side's plane, so that the depth has no say.
    const double behind = distance(plane, at);
    const double nv = plane.normal.dot(v), dv = line.normal.dot(v);
    const double slope = dv / nv;
    (*residuals)[i] = distance(line, at) - slope * behind -
                      parameters.nuisance[kEdgeShift + edge.axis] * edge.pixel;
    if (!jacobian) continue;
    jacobian->row(i) = differentiate(line, edge.p, at) - slope * differentiate(plane, edge.p, at);
    const Eigen::Vector3d turn = (line.normal * nv - plane.normal * dv) / (nv * nv);
    jacobian->row(i).head<4>() -=
        behind * turn.transpose() * RotatedPointJacobian(parameters.pose, ray);
    (*jacobian)(i, kBuildColumn + BuildModel::Yaw(side.box)) -=
        behind *
        (VerticalCross(line.normal).dot(v) * nv - VerticalCross(plane.normal).dot(v) * dv) /
        (nv * nv);
    (*jacobian)(i, kNuisanceColumn + kEdgeShift + edge.axis) = -edge.pixel;
  }
}

void SetCovariance(const BuildModel& model, const Pose& pose, SensorEvidence* evidence) {
  const NoiseModel& noise = evidence->noise;
  const Eigen::VectorXd gain = WarpGain(model, pose, *evidence);
  Eigen::MatrixXd faces =
      noise.warp * noise.warp * WarpCorrelation(*evidence, gain, noise.warp_length);
  faces.diagonal() += FaceVariances(model, pose, *evidence);
  evidence->face_root = faces.llt().matrixL();
  const Eigen::MatrixXd edges = noise.edge * noise.edge * EdgeCovariance(*evidence);
  evidence->edge_root = edges.llt().matrixL();
}

void FitNoise(const BuildModel& model, const SensorParameters& parameters, const Priors& priors,
              SensorEvidence* evidence) {
  // Some of the observations are enough for three numbers.
  constexpr std::size_t kMost = 110;
  const auto some = [](const auto& all) {
    auto chosen = all;
    if (all.size() > kMost) {
      chosen.clear();
      for (std::size_t i = 0; i < kMost; ++i) chosen.push_back(all[i * all.size() / kMost]);
    }
    return chosen;
  };
  SensorEvidence sample;
  sample.noise = evidence->noise;
  sample.faces = some(evidence->faces);
  sample.edges = some(evidence->edges);
  Eigen::VectorXd residuals;
  Eigen::MatrixXd ambient;
  Residuals(model, sample, parameters, &residuals, &ambient);
  Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
  LeftPoseManifold().PlusJacobian(parameters.pose, plus.data());
  const Eigen::MatrixXd free = ambient.leftCols<7>() * plus;
  Eigen::VectorXd sigmas(ambient.cols() - 7);
  sigmas[0] = priors.offset;
  sigmas[1 + kDepthGain] = priors.gain;
  sigmas[1 + kMultipath] = 0;
  sigmas[1 + kEdgeShift] = sigmas[2 + kEdgeShift] = priors.edge_shift;
  sigmas[1 + kNuisances] = priors.size;
  for (Eigen::Index i = 2 + kNuisances; i < sigmas.size(); ++i)
    sigmas[i] = (i - 2 - kNuisances) % 3 == 2 ? priors.yaw : priors.box;
  // About zero: the residuals without what the parameters took away.
  Eigen::VectorXd values(sigmas.size());
  values[0] = parameters.offset[0];
  for (int i = 0; i < kNuisances; ++i) values[1 + i] = parameters.nuisance[i];
  for (int i = 0; i < model.size(); ++i) values[1 + kNuisances + i] = parameters.build[i];
  const Eigen::MatrixXd known = ambient.rightCols(sigmas.size());
  residuals -= known * values;
  const Eigen::MatrixXd shared = known * sigmas.asDiagonal();
  const Eigen::MatrixXd seam = known.col(1 + kMultipath);

  const auto faces = static_cast<Eigen::Index>(sample.faces.size());
  const auto edges = static_cast<Eigen::Index>(sample.edges.size());
  NoiseModel& noise = evidence->noise;
  PoseBlock block;
  std::copy_n(parameters.pose, 7, block.values);
  const Pose pose = block.ToPose();
  if (faces > 12) {
    const Eigen::MatrixXd j = free.topRows(faces);
    const Eigen::VectorXd r = residuals.head(faces);
    const Eigen::VectorXd gain = WarpGain(model, pose, sample);
    Eigen::MatrixXd rest = shared.topRows(faces) * shared.topRows(faces).transpose();
    rest.diagonal() += FaceVariances(model, pose, sample);
    const Eigen::VectorXd m = seam.col(0).head(faces);
    double least = std::numeric_limits<double>::infinity();
    const Eigen::MatrixXd multipath = m * m.transpose();
    const double sigma_m = 0.012;
    for (const double length : {0.05, 0.1, 0.18}) {
      const Eigen::MatrixXd correlation = WarpCorrelation(sample, gain, length);
      double warp = 0;
      const double cost = MinimiseOverLog(
          3e-4, 0.02, 8,
          [&](double sigma) {
            // What sensors do (facts/sensors.md): 3-6 mm for time of flight, 8-20 mm for stereo.
            // Free of it, a warp can explain a tilt.
            const double unusual = std::log(sigma / 0.005) / 0.8;
            return RestrictedCost(
                       sigma * sigma * correlation + rest + sigma_m * sigma_m * multipath, r, j) +
                   0.5 * unusual * unusual;
          },
          &warp);
      if (cost < least) {
        least = cost;
        noise.warp = warp;
        noise.warp_length = length;
      }
    }
    const Eigen::MatrixXd others =
        noise.warp * noise.warp * WarpCorrelation(sample, gain, noise.warp_length) + rest;
    least = std::numeric_limits<double>::infinity();
    for (const double sigma : {0.001, 0.005, 0.012}) {
      const double cost = RestrictedCost(others + sigma * sigma * multipath, r, j);
      if (cost < least) {
        least = cost;
        noise.multipath = sigma;
      }
    }
  }
  if (edges > 8) {
    const Eigen::MatrixXd j = free.bottomRows(edges);
    const Eigen::VectorXd r = residuals.tail(edges);
    const Eigen::MatrixXd rest = shared.bottomRows(edges) * shared.bottomRows(edges).transpose();
    const Eigen::MatrixXd own = EdgeCovariance(sample);
    MinimiseOverLog(
        0.25, 8, 6,
        [&](double scale) {
          const double unusual = std::log(scale) / 1.0;
          return RestrictedCost(scale * scale * own + rest, r, j) + 0.5 * unusual * unusual;
        },
        &noise.edge);
  }
  SetCovariance(model, pose, evidence);
}

SensorCost::SensorCost(const BuildModel& model, const SensorEvidence& evidence)
    : model_(model), evidence_(evidence) {
  set_num_residuals(static_cast<int>(evidence.faces.size() + evidence.edges.size()));
  *mutable_parameter_block_sizes() = {7, 1, kNuisances, model.size()};
}

bool SensorCost::Evaluate(double const* const* parameters, double* residuals,
                          double** jacobians) const {
  Eigen::VectorXd r;
  Eigen::MatrixXd j;
  Residuals(model_, evidence_, {parameters[0], parameters[1], parameters[2], parameters[3]}, &r,
            jacobians ? &j : nullptr);
  const auto faces = static_cast<Eigen::Index>(evidence_.faces.size());
  const auto edges = static_cast<Eigen::Index>(evidence_.edges.size());
  const auto face_root = evidence_.face_root.triangularView<Eigen::Lower>();
  const auto edge_root = evidence_.edge_root.triangularView<Eigen::Lower>();
  Eigen::Map<Eigen::VectorXd> out(residuals, faces + edges);
  out.head(faces) = face_root.solve(r.head(faces));
  out.tail(edges) = edge_root.solve(r.tail(edges));
  if (!jacobians) return true;
  j.topRows(faces) = face_root.solve(j.topRows(faces)).eval();
  j.bottomRows(edges) = edge_root.solve(j.bottomRows(edges)).eval();
  Eigen::Index column = 0;
  for (std::size_t b = 0; b < parameter_block_sizes().size(); ++b) {
    const Eigen::Index width = parameter_block_sizes()[b];
    if (jacobians[b]) {
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> block(
          jacobians[b], faces + edges, width);
      block = j.middleCols(column, width);
    }
    column += width;
  }
  return true;
}

PriorCost::PriorCost(std::vector<double> sigmas) : sigmas_(std::move(sigmas)) {
  set_num_residuals(static_cast<int>(sigmas_.size()));
  *mutable_parameter_block_sizes() = {static_cast<int>(sigmas_.size())};
}

bool PriorCost::Evaluate(double const* const* parameters, double* residuals,
                         double** jacobians) const {
  const auto n = static_cast<Eigen::Index>(sigmas_.size());
  for (std::size_t i = 0; i < sigmas_.size(); ++i) residuals[i] = parameters[0][i] / sigmas_[i];
  if (jacobians && jacobians[0]) {
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> j(
        jacobians[0], n, n);
    j.setZero();
    for (std::size_t i = 0; i < sigmas_.size(); ++i) {
      const auto d = static_cast<Eigen::Index>(i);
      j(d, d) = 1 / sigmas_[i];
    }
  }
  return true;
}

}  // namespace volalign::refine_internal
