#include "core/geometry/pose.h"

#include <fmt/format.h>

#include <cmath>

#include "core/base/error.h"
#include "core/base/random.h"

namespace volalign {

Eigen::Matrix3d RotationExp(const Eigen::Vector3d& rotation_vector) {
  const double angle = rotation_vector.norm();
  if (angle < 1e-12) return Eigen::Matrix3d::Identity() + Cross(rotation_vector);
  return Eigen::AngleAxisd(angle, rotation_vector / angle).toRotationMatrix();
}

Eigen::Vector3d RotationLog(const Eigen::Matrix3d& rotation) {
  const Eigen::AngleAxisd angle_axis{rotation};
  return angle_axis.angle() * angle_axis.axis();
}

Pose PerturbLeft(const Vector6d& delta, const Pose& pose) {
  const Eigen::Matrix3d r = RotationExp(delta.tail<3>());
  Pose result = Pose::Identity();
  result.linear() = r * pose.linear();
  result.translation() = r * pose.translation() + delta.head<3>();
  return result;
}

Eigen::Matrix3d Cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Vector6d LeftDifference(const Pose& from, const Pose& to) {
  const Eigen::Matrix3d rotation = to.linear() * from.linear().transpose();
  Vector6d delta;
  delta << to.translation() - rotation * from.translation(), RotationLog(rotation);
  return delta;
}

Matrix6d Adjoint(const Pose& pose) {
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = pose.linear();
  adjoint.topRightCorner<3, 3>().noalias() = Cross(pose.translation()) * pose.linear();
  return adjoint;
}

PoseError ComparePoses(const Pose& a, const Pose& b) {
  PoseError error;
  error.translation_m = (a.translation() - b.translation()).norm();
  error.rotation_deg =
      RotationLog(a.linear().transpose() * b.linear()).norm() * (180.0 / 3.14159265358979323846);
  return error;
}

Pose LookAt(const Eigen::Vector3d& position, const Eigen::Vector3d& target, double roll) {
  const Eigen::Vector3d forward = target - position;
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitY());
  if (!std::isfinite(roll)) throw Error(fmt::format("a sensor is rolled by {} rad", roll));
  if (!(right.norm() > 1e-6 * forward.norm())) {
    throw Error(
        fmt::format("a sensor at ({}, {}, {}) that looks at ({}, {}, {}) has no level orientation: "
                    "move the look-at point "
                    "aside, so that the sensor does not look straight up or down",
                    position.x(), position.y(), position.z(), target.x(), target.y(), target.z()));
  }
  Eigen::Matrix3d level;
  level.col(0) = right.normalized();
  level.col(2) = forward.normalized();
  level.col(1) = level.col(2).cross(level.col(0));
  // A sensor turned by roll > 0 has its x axis lower: towards the level frame's +y, down.
  Pose pose = Pose::Identity();
  pose.linear() = level * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  pose.translation() = position;
  return pose;
}

int UprightTurns(const Pose& structure_from_sensor) {
  const Eigen::Vector3d down =
      structure_from_sensor.linear().transpose() * -Eigen::Vector3d::UnitY();
  if (std::abs(down.x()) > std::abs(down.y())) return down.x() > 0 ? 1 : 3;
  return down.y() >= 0 ? 0 : 2;
}

std::vector<std::vector<double>> ToRows(const Pose& pose) {
  std::vector<std::vector<double>> rows(4, std::vector<double>(4));
  const Eigen::Matrix4d& m = pose.matrix();
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c)
      rows[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)] = m(r, c);
  }
  return rows;
}

Pose PoseFromMatrix(const Eigen::Matrix4d& m, const std::string& what) {
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  const bool rigid =
      m.allFinite() && (m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() < 1e-6 &&
      (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).norm() < 1e-3 &&
      rotation.determinant() > 0;
  if (!rigid) {
    throw DataError(what +
                    " is not a rigid transform: row-major, metres, a proper rotation and the last "
                    "row [0, 0, 0, 1] "
                    "are expected (is it transposed, or in millimetres?)");
  }
  Pose pose = Pose::Identity();
  pose.linear() = rotation;
  pose.translation() = m.topRightCorner<3, 1>();
  return pose;
}

Eigen::Vector3d PointInBall(double radius, RandomStream& random) {
  const double cos_polar = random.Uniform(-1, 1);
  const double azimuth = random.Uniform(0, 2 * M_PI);
  const double distance = radius * std::cbrt(random.Uniform());
  const double sin_polar = std::sqrt(1 - cos_polar * cos_polar);
  return distance *
         Eigen::Vector3d(sin_polar * std::cos(azimuth), cos_polar, sin_polar * std::sin(azimuth));
}

}  // namespace volalign
