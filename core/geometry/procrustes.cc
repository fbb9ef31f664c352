#include "core/geometry/procrustes.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include <cmath>

#include "core/base/error.h"

namespace volalign {

ProcrustesResult AlignPoints(const std::vector<Eigen::Vector3d>& source,
                             const std::vector<Eigen::Vector3d>& target,
                             const std::vector<double>& weights) {
  if (source.empty() || source.size() != target.size() ||
      (!weights.empty() && weights.size() != source.size())) {
    throw Error("AlignPoints: " + std::to_string(source.size()) + " source points, " +
                std::to_string(target.size()) + " target points and " +
                std::to_string(weights.size()) + " weights; equal, positive numbers are expected");
  }
  const auto weight = [&](std::size_t i) { return weights.empty() ? 1.0 : weights[i]; };
  double total = 0;
  Eigen::Vector3d source_mean = Eigen::Vector3d::Zero(), target_mean = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < source.size(); ++i) {
    total += weight(i);
    source_mean += weight(i) * source[i];
    target_mean += weight(i) * target[i];
  }
  if (!(total > 0)) throw Error("AlignPoints: the weights' sum is not positive");
  source_mean /= total;
  target_mean /= total;

  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero(), spread = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < source.size(); ++i) {
    const Eigen::Vector3d s = source[i] - source_mean, t = target[i] - target_mean;
    cross += weight(i) * t * s.transpose();
    spread += weight(i) * t * t.transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs(1, 1,
                        svd.matrixU().determinant() * svd.matrixV().determinant() < 0 ? -1 : 1);
  ProcrustesResult result;
  result.target_from_source.linear() =
      svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  result.target_from_source.translation() =
      target_mean - result.target_from_source.linear() * source_mean;

  double squares = 0;
  for (std::size_t i = 0; i < source.size(); ++i) {
    squares += weight(i) * (target[i] - result.target_from_source * source[i]).squaredNorm();
  }
  result.rms = std::sqrt(squares / total);
  const Eigen::Vector3d variances =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread / total).eigenvalues();
  for (int i = 0; i < 3; ++i) result.extents[i] = std::sqrt(std::max(0.0, variances[2 - i]));
  return result;
}

double SecondSingularValue(const std::vector<Eigen::Vector3d>& points) {
  if (points.size() < 2) return 0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  Eigen::MatrixXd centred(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    centred.col(static_cast<Eigen::Index>(i)) = points[i] - mean;
  }
  return Eigen::JacobiSVD<Eigen::MatrixXd>(centred).singularValues()[1];
}

}  // namespace volalign
