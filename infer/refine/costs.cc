#include "infer/refine/costs.h"

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/normal_prior.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <limits>
#include <utility>

#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

namespace {

/// The loss of matches, in standard deviations.
const ceres::LossFunction& RobustLoss() {
  static const ceres::CauchyLoss loss(2);
  return loss;
}

using Row7 = Eigen::Matrix<double, 1, 7>;

/// Derivative of a . (R p + t).
Row7 DotJacobian(const double* pose, const Eigen::Vector3d& p, const Eigen::Vector3d& a) {
  Row7 row;
  row.head<4>() = a.transpose() * RotatedPointJacobian(pose, p);
  row.tail<3>() = a.transpose();
  return row;
}

/// R v, without the translation.
Eigen::Vector3d Rotate(const double* pose, const Eigen::Vector3d& v) {
  const Eigen::Vector3d u(pose[0], pose[1], pose[2]);
  const Eigen::Vector3d cross = 2 * u.cross(v);
  return v + pose[3] * cross + u.cross(cross);
}

Eigen::Vector3d Transform(const double* pose, const Eigen::Vector3d& p) {
  return Rotate(pose, p) + Eigen::Vector3d(pose[4], pose[5], pose[6]);
}

/// Standard deviations, m and rad.
struct PoseSigmas {
  double translation, rotation;
};

/// [apart; 2 vec(turn)] over their standard deviations.
template <class T>
void Whiten(const Eigen::Matrix<T, 3, 1>& apart, Eigen::Quaternion<T> turn,
            const PoseSigmas& sigmas, T* residuals) {
  if (turn.w() < T(0)) turn.coeffs() = -turn.coeffs();
  for (int k = 0; k < 3; ++k) {
    residuals[k] = apart[k] / T(sigmas.translation);
    residuals[3 + k] = T(2) * turn.coeffs()[k] / T(sigmas.rotation);
  }
}

/// The rotation and the translation of a pose's block.
template <class T>
Eigen::Quaternion<T> RotationOf(const T* block) {
  return Eigen::Map<const Eigen::Quaternion<T>>(block).normalized();
}
template <class T>
Eigen::Matrix<T, 3, 1> TranslationOf(const T* block) {
  return Eigen::Map<const Eigen::Matrix<T, 3, 1>>(block + 4);
}

/// See PosePriorCost.
struct LoosePrior {
  Pose prior;
  PoseSigmas sigmas;

  template <class T>
  bool operator()(const T* pose, T* residuals) const {
    const Eigen::Quaternion<T> q = RotationOf(pose);
    const Eigen::Matrix<T, 3, 1> origin = prior.inverse().translation().cast<T>();
    const Eigen::Matrix<T, 3, 1> apart = q * origin + TranslationOf(pose);
    Whiten(apart, q * Eigen::Quaterniond(prior.linear()).conjugate().cast<T>(), sigmas, residuals);
    return true;
  }
};

/// See TieCost.
struct Tie {
  PoseSigmas sigmas;

  template <class T>
  bool operator()(const T* placement_a, const T* pose_a, const T* placement_b, const T* pose_b,
                  T* residuals) const {
    const Eigen::Quaternion<T> of_a = RotationOf(placement_a), of_b = RotationOf(placement_b);
    const Eigen::Matrix<T, 3, 1> apart =
        of_b * TranslationOf(pose_b) + TranslationOf(placement_b) -
        (of_a * TranslationOf(pose_a) + TranslationOf(placement_a));
    Whiten(apart, (of_b * RotationOf(pose_b)) * (of_a * RotationOf(pose_a)).conjugate(), sigmas,
           residuals);
    return true;
  }
};

/// See KnownPoseCost.
struct KnownPose {
  Pose prior;
  PoseSigmas sigmas;

  template <class T>
  bool operator()(const T* world, const T* scale, const T* placement, const T* pose,
                  T* residuals) const {
    using std::exp;
    const Eigen::Quaternion<T> of_world = RotationOf(world), of_placement = RotationOf(placement);
    const Eigen::Matrix<T, 3, 1> apart =
        of_placement * TranslationOf(pose) + TranslationOf(placement) -
        (of_world * (exp(*scale) * prior.translation().cast<T>()) + TranslationOf(world));
    const Eigen::Quaternion<T> expected = of_world * Eigen::Quaterniond(prior.linear()).cast<T>();
    Whiten(apart, of_placement * RotationOf(pose) * expected.conjugate(), sigmas, residuals);
    return true;
  }
  template <class T>
  bool operator()(const T* world, const T* placement, const T* pose, T* residuals) const {
    const T metric(0);
    return (*this)(world, &metric, placement, pose, residuals);
  }
  template <class T>
  bool operator()(const T* placement, const T* pose, T* residuals) const {
    const T identity[] = {T(0), T(0), T(0), T(1), T(0), T(0), T(0)};
    return (*this)(identity, placement, pose, residuals);
  }
};

/// See DriftCost.
struct Drift {
  double sigma;

  template <class T>
  bool operator()(const T* a, const T* b, T* residual) const {
    *residual = (*b - *a) / T(sigma);
    return true;
  }
};

}  // namespace

ceres::CostFunction* TieCost(double sigma_translation, double sigma_rotation) {
  return new ceres::AutoDiffCostFunction<Tie, 6, 7, 7, 7, 7>(
      new Tie{{sigma_translation, sigma_rotation}});
}

ceres::CostFunction* KnownPoseCost(const PosePrior& prior) {
  auto* known = new KnownPose{prior.world_from_sensor, {prior.sigma_m, prior.sigma_deg * kDegree}};
  switch (prior.world) {
    case PriorWorld::kStructure:
      return new ceres::AutoDiffCostFunction<KnownPose, 6, 7, 7>(known);
    case PriorWorld::kMetric:
      return new ceres::AutoDiffCostFunction<KnownPose, 6, 7, 7, 7>(known);
    case PriorWorld::kScaleFree:
      break;
  }
  return new ceres::AutoDiffCostFunction<KnownPose, 6, 7, 1, 7, 7>(known);
}

ceres::CostFunction* PosePriorCost(const Pose& prior, double sigma_translation,
                                   double sigma_rotation) {
  return new ceres::AutoDiffCostFunction<LoosePrior, 6, 7>(
      new LoosePrior{prior, {sigma_translation, sigma_rotation}});
}

ceres::CostFunction* PriorCost(const Eigen::VectorXd& sigmas) {
  return new ceres::NormalPrior(sigmas.cwiseInverse().asDiagonal().toDenseMatrix(),
                                Eigen::VectorXd::Zero(sigmas.size()));
}

ceres::CostFunction* LensEvidenceCost(const LensEvidence& evidence) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(evidence.information);
  const Eigen::Vector3d values = solver.eigenvalues().cwiseMax(0);
  // The mean is arbitrary along directions of which the planes say nothing.
  const double least = 1e-12 * values.maxCoeff();
  const Eigen::Vector3d moment = solver.eigenvectors().transpose() * evidence.moment;
  const Eigen::Vector3d mean = (values.array() > least).select(moment.cwiseQuotient(values), 0);
  return new ceres::NormalPrior(values.cwiseSqrt().asDiagonal() * solver.eigenvectors().transpose(),
                                solver.eigenvectors() * mean);
}

ceres::CostFunction* DriftCost(double sigma) {
  return new ceres::AutoDiffCostFunction<Drift, 1, 1, 1>(new Drift{sigma});
}

double PointToPlane(const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Eigen::Vector3d& n,
                    double weight, double const* const* parameters, double** jacobians) {
  const double *a = parameters[0], *b = parameters[1];
  const Eigen::Vector3d from_b = Transform(a, p) - Eigen::Vector3d(b[4], b[5], b[6]);
  const Eigen::Vector3d normal = Rotate(b, n);
  const double distance = weight * (normal.dot(from_b) - n.dot(q));
  if (!jacobians) return distance;
  if (jacobians[0]) {
    Eigen::Map<Row7> j(jacobians[0]);
    j = weight * DotJacobian(a, p, normal);
  }
  if (jacobians[1]) {
    Eigen::Map<Row7> j(jacobians[1]);
    j.head<4>() = weight * from_b.transpose() * RotatedPointJacobian(b, n);
    j.tail<3>() = -weight * normal.transpose();
  }
  return distance;
}

RobustResidual MakeRobust(double residual, double share) {
  const double square = residual * residual;
  std::array<double, 3> loss{};  // and its derivatives by the square
  RobustLoss().Evaluate(square, loss.data());
  const double root =
      square > std::numeric_limits<float>::epsilon() ? std::sqrt(loss[0] / square) : 1;
  return {residual * std::sqrt(share) * root, std::sqrt(share) * loss[1] / root};
}

MeasuredOverlapCost::MeasuredOverlapCost(std::vector<MeasuredMatch> matches, double share,
                                         bool shared)
    : matches_(std::move(matches)), share_(share), shared_(shared) {
  set_num_residuals(static_cast<int>(matches_.size()));
  *mutable_parameter_block_sizes() = {7, 7, 1, 1, kSensorErrors, kSensorErrors, kLensParameters};
  if (!shared) mutable_parameter_block_sizes()->push_back(kLensParameters);
}

bool MeasuredOverlapCost::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  const std::vector<std::int32_t>& sizes = parameter_block_sizes();
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    std::array<double*, 8> rows{};  // of the Jacobians
    for (std::size_t k = 0; jacobians && k < sizes.size(); ++k) {
      if (jacobians[k]) rows[k] = jacobians[k] + i * static_cast<std::size_t>(sizes[k]);
    }
    EvaluateMatch(matches_[i], parameters, &residuals[i], jacobians ? rows.data() : nullptr);
    const RobustResidual robust = MakeRobust(residuals[i], share_);
    residuals[i] = robust.value;
    for (std::size_t k = 0; jacobians && k < sizes.size(); ++k) {
      for (std::int32_t j = 0; rows[k] && j < sizes[k]; ++j) rows[k][j] *= robust.slope;
    }
  }
  return true;
}

void MeasuredOverlapCost::EvaluateMatch(const MeasuredMatch& match, double const* const* parameters,
                                        double* residual, double** jacobians) const {
  constexpr int kOffset = 2, kErrors = kOffset + 2, kLens = kErrors + 2;  // of a; those of b follow
  const int lens_b = shared_ ? kLens : kLens + 1;
  const Eigen::Map<const SensorErrorVector> errors_a(parameters[kErrors]),
      errors_b(parameters[kErrors + 1]);
  const Eigen::Vector3d seen_a = match.a.Through(parameters[kLens], errors_a[kFocal]),
                        seen_b = match.b.Through(parameters[lens_b], errors_b[kFocal]);
  const Eigen::Vector3d p = Corrected(seen_a, 0,
                                      *parameters[kOffset] + match.a.by_errors.dot(errors_a)),
                        q = Corrected(seen_b, 0,
                                      *parameters[kOffset + 1] + match.b.by_errors.dot(errors_b));
  const double gain = 1 + (errors_a[kGain] + errors_b[kGain]) / 2;
  const double weight = match.weight / gain;
  *residual = PointToPlane(p, q, match.n_b, weight, parameters, jacobians);
  if (!jacobians) return;
  if (shared_ && jacobians[kLens]) std::fill_n(jacobians[kLens], kLensParameters, 0.0);
  // `by_point`: derivative by where the corrected point is.
  const auto add = [&](const Eigen::RowVector3d& by_point, const LensPoint& point,
                       const Eigen::Vector3d& seen, double true_depth, int b, int lens) {
    const double by_offset = by_point.dot(seen) / seen.z();
    if (jacobians[kOffset + b]) jacobians[kOffset + b][0] = by_offset;
    const Eigen::RowVector3d by_lens = true_depth * by_point.head<2>() * point.by_lens;
    if (jacobians[kErrors + b]) {
      Eigen::Map<SensorErrorVector> of_errors(jacobians[kErrors + b]);
      of_errors = by_offset * point.by_errors;
      of_errors[kGain] -= *residual / (2 * gain);
      of_errors[kFocal] = by_lens[0];
    }
    if (!jacobians[lens]) return;
    Eigen::Map<Eigen::RowVector3d> of_lens(jacobians[lens]);
    if (!shared_) of_lens.setZero();
    of_lens += by_lens;
  };
  const Eigen::Vector3d normal_in_a =
      Eigen::Quaterniond(parameters[0]).conjugate() * Rotate(parameters[1], match.n_b);
  add(weight * normal_in_a.transpose(), match.a, seen_a, p.z(), 0, kLens);
  add(-weight * match.n_b.transpose(), match.b, seen_b, q.z(), 1, lens_b);
}

}  // namespace volalign::refine_internal
