#include "infer/initial/sides_fix_pose.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <set>

#include "core/geometry/pose.h"
#include "core/geometry/procrustes.h"

namespace volalign {

namespace {

/// Least eigenvalue of the normal equations, as a share of their trace.
constexpr double kMinEigenvalueShare = 0.003;

struct PlanePoint {
  Eigen::Vector3d p, normal;
};

}  // namespace

bool SidesFixPose(const Structure& structure, const std::vector<int>& labels) {
  const std::set<int> unique(labels.begin(), labels.end());
  std::vector<Eigen::Vector3d> keypoints;
  keypoints.reserve(unique.size());
  for (const int label : unique)
    keypoints.push_back(structure.Keypoint(label, KeypointKind::kExposed));
  if (keypoints.size() >= 3 && SecondSingularValue(keypoints) > kMinSecondSingularValue)
    return true;

  // Four points at this share of a rectangle's half extents have its second moments.
  const double moment_point = 1 / std::sqrt(3);
  std::vector<PlanePoint> points;
  for (const int label : unique) {
    const Side& side = structure.SideOfLabel(label);
    for (const double u : {-moment_point, moment_point}) {
      for (const double v : {-moment_point, moment_point}) {
        points.push_back(
            {side.centre + u * side.half_u * side.axis_u + v * side.half_v * side.axis_v,
             side.normal});
      }
    }
  }
  if (points.empty()) return false;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const PlanePoint& point : points) middle += point.p;
  middle /= static_cast<double>(points.size());
  double arm = 0;
  for (const PlanePoint& point : points) arm += (point.p - middle).squaredNorm();
  arm = std::sqrt(arm / static_cast<double>(points.size()));
  Matrix6d normal_matrix = Matrix6d::Zero();
  for (const PlanePoint& point : points) {
    Vector6d row;
    row << point.normal, (point.p - middle).cross(point.normal) / arm;
    normal_matrix += row * row.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(normal_matrix);
  return solver.eigenvalues()[0] > kMinEigenvalueShare * normal_matrix.trace();
}

}  // namespace volalign
