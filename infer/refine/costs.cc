#include "infer/refine/costs.h"

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <utility>

#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

namespace {

constexpr double kLossScale = 2;  // standard deviations, where Cauchy's loss bends

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

/// See TieCost.
struct Tie {
  double sigma_translation, sigma_rotation;

  template <class T>
  bool operator()(const T* placement_a, const T* pose_a, const T* placement_b, const T* pose_b,
                  T* residuals) const {
    using Quaternion = Eigen::Quaternion<T>;
    using Vector = Eigen::Matrix<T, 3, 1>;
    const auto rotation = [](const T* block) {
      return Eigen::Map<const Quaternion>(block).normalized();
    };
    const auto translation = [](const T* block) { return Eigen::Map<const Vector>(block + 4); };
    const Quaternion of_a = rotation(placement_a), of_b = rotation(placement_b);
    const Vector apart = of_b * translation(pose_b) + translation(placement_b) -
                         (of_a * translation(pose_a) + translation(placement_a));
    Quaternion turn = (of_b * rotation(pose_b)) * (of_a * rotation(pose_a)).conjugate();
    if (turn.w() < T(0)) turn.coeffs() = -turn.coeffs();
    for (int k = 0; k < 3; ++k) {
      residuals[k] = apart[k] / T(sigma_translation);
      residuals[3 + k] = T(2) * turn.coeffs()[k] / T(sigma_rotation);
    }
    return true;
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
      new Tie{sigma_translation, sigma_rotation});
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
  const double x = residual * residual / (kLossScale * kLossScale);
  const double loss = x > 0 ? std::log1p(x) / x : 1;  // as a share of the square
  return {residual * std::sqrt(share * loss), std::sqrt(share / loss) / (1 + x)};
}

MeasuredOverlapCost::MeasuredOverlapCost(std::vector<MeasuredMatch> matches, double share,
                                         bool shared)
    : matches_(std::move(matches)), share_(share), shared_(shared) {
  set_num_residuals(static_cast<int>(matches_.size()));
  *mutable_parameter_block_sizes() = {
      7, 7, 1, 1, 1, 1, 1, 1, kFrameErrors, kFrameErrors, kLensParameters};
  if (!shared) mutable_parameter_block_sizes()->push_back(kLensParameters);
}

bool MeasuredOverlapCost::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  const std::vector<std::int32_t>& sizes = parameter_block_sizes();
  for (std::size_t i = 0; i < matches_.size(); ++i) {
    std::array<double*, 12> rows{};  // of the Jacobians
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
  constexpr int kOffset = 2, kGain = kOffset + 2, kFocal = kGain + 2, kErrors = kFocal + 2,
                kLens = kErrors + 2;  // of a; those of b follow
  const int lens_b = shared_ ? kLens : kLens + 1;
  const Eigen::Vector3d seen_a = match.a.Through(parameters[kLens], *parameters[kFocal]),
                        seen_b = match.b.Through(parameters[lens_b], *parameters[kFocal + 1]);
  const auto corrected = [&](const LensPoint& point, const Eigen::Vector3d& seen, int b) {
    const double more =
        point.by_errors.dot(Eigen::Map<const FrameErrorVector>(parameters[kErrors + b]));
    return Corrected(seen, parameters[kGain + b][0], parameters[kOffset + b][0] + more);
  };
  const Eigen::Vector3d p = corrected(match.a, seen_a, 0), q = corrected(match.b, seen_b, 1);
  const double gain = 1 + (parameters[kGain][0] + parameters[kGain + 1][0]) / 2;
  const double weight = match.weight / gain;
  *residual = PointToPlane(p, q, match.n_b, weight, parameters, jacobians);
  if (!jacobians) return;
  if (shared_ && jacobians[kLens]) std::fill_n(jacobians[kLens], kLensParameters, 0.0);
  // `by_point`: derivative by where the corrected point is.
  const auto add = [&](const Eigen::RowVector3d& by_point, const LensPoint& point,
                       const Eigen::Vector3d& seen, double true_depth, int b, int lens) {
    const double by_offset = by_point.dot(seen) / seen.z();
    if (jacobians[kOffset + b]) jacobians[kOffset + b][0] = by_offset;
    if (jacobians[kErrors + b])
      Eigen::Map<FrameErrorVector>{jacobians[kErrors + b]} = by_offset * point.by_errors;
    if (jacobians[kGain + b]) jacobians[kGain + b][0] = by_point.dot(seen) - *residual / (2 * gain);
    const Eigen::RowVector3d by_lens = true_depth * by_point.head<2>() * point.by_lens;
    if (jacobians[kFocal + b]) jacobians[kFocal + b][0] = by_lens[0];
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

LensEvidenceCost::LensEvidenceCost(const LensEvidence& evidence) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(evidence.information);
  const Eigen::Vector3d values = solver.eigenvalues().cwiseMax(0);
  const double least = 1e-12 * values.maxCoeff();
  root_ = values.cwiseSqrt().asDiagonal() * solver.eigenvectors().transpose();
  const Eigen::Vector3d moment = solver.eigenvectors().transpose() * evidence.moment;
  for (int k = 0; k < kLensParameters; ++k)
    target_[k] = values[k] > least ? moment[k] / std::sqrt(values[k]) : 0;
}

bool LensEvidenceCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  Eigen::Map<Eigen::Vector3d>{residuals} =
      root_ * Eigen::Map<const LensChange>(parameters[0]) - target_;
  if (jacobians && jacobians[0])
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{jacobians[0]} = root_;
  return true;
}

bool PosePriorCost::Evaluate(double const* const* parameters, double* residuals,
                             double** jacobians) const {
  const double* pose = parameters[0];
  const Eigen::Vector3d u(pose[0], pose[1], pose[2]);
  const Eigen::Vector3d u0(prior_.values[0], prior_.values[1], prior_.values[2]);
  const double w0 = prior_.values[3];
  const Eigen::Vector3d turn = -pose[3] * u0 + w0 * u + u0.cross(u);
  Eigen::Map<Vector6d> r(residuals);
  const Eigen::Quaterniond q(pose);
  r.head<3>() =
      (q.normalized() * origin_ + Eigen::Vector3d(pose[4], pose[5], pose[6])) / sigma_translation_;
  r.tail<3>() = 2 * turn / sigma_rotation_;
  if (jacobians && jacobians[0]) {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobians[0]);
    j.setZero();
    j.block<3, 4>(0, 0) = RotatedPointJacobian(pose, origin_) / sigma_translation_;
    j.block<3, 3>(0, 4) = Eigen::Matrix3d::Identity() / sigma_translation_;
    j.block<3, 3>(3, 0) = 2 / sigma_rotation_ * (w0 * Eigen::Matrix3d::Identity() + Cross(u0));
    j.block<3, 1>(3, 3) = -2 / sigma_rotation_ * u0;
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
