#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <vector>

namespace volalign {

class RandomStream;

/// A rigid transform, always named target_from_source: p_target = pose * p_source.
using Pose = Eigen::Isometry3d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
/// 1 deg in rad.
inline constexpr double kDegree = M_PI / 180;

/// Rotation matrix of a rotation vector (axis * angle, rad), and back (angle in [0, pi]).
Eigen::Matrix3d RotationExp(const Eigen::Vector3d& rotation_vector);
Eigen::Vector3d RotationLog(const Eigen::Matrix3d& rotation);

/// Perturbs a pose on the left: T = Exp(delta) T^, which is R = Exp(w) R^, t = Exp(w) t^ + v. In
/// delta = [v; w], v is a translation (m) and w a rotation vector (rad) in the target frame.
/// Covariances are delta's.
Pose PerturbLeft(const Vector6d& delta, const Pose& pose);

/// Matrix of the cross product: Cross(v) * w = v x w.
Eigen::Matrix3d Cross(const Eigen::Vector3d& v);

/// The delta with PerturbLeft(delta, from) = to.
Vector6d LeftDifference(const Pose& from, const Pose& to);

/// T Exp(delta) = Exp(Adjoint(T) delta) T, for delta = [translation; rotation vector].
Matrix6d Adjoint(const Pose& pose);

struct PoseError {
  double translation_m = 0;  ///< distance between the two sensor positions
  double rotation_deg = 0;   ///< angle of the relative rotation
};
/// Error between two poses target_from_sensor.
PoseError ComparePoses(const Pose& a, const Pose& b);

/// structure_from_sensor of a sensor (OpenCV axes: x right, y down, z forward) at `position` that
/// looks at `target`. The sensor is levelled: its x axis is parallel to the floor (y is up in the
/// structure frame). It is then turned about its optical axis by `roll` rad. A roll of +90 deg
/// turns the image's +x to the floor. Throws Error if the viewing direction is vertical or has no
/// length.
Pose LookAt(const Eigen::Vector3d& position, const Eigen::Vector3d& target, double roll);

/// Clockwise quarter turns (core/base/image.h, Turn) that bring the floor to the bottom of the
/// picture.
int UprightTurns(const Pose& structure_from_sensor);

/// 4x4 row-major nested vectors, as in JSON files.
std::vector<std::vector<double>> ToRows(const Pose& pose);

/// Throws DataError, with `what` in its message, unless the matrix is a finite rigid transform with
/// determinant +1 (tolerance 1e-3).
Pose PoseFromMatrix(const Eigen::Matrix4d& matrix, const std::string& what);

/// Uniform in the ball of this radius about the origin, in the radius' unit.
Eigen::Vector3d PointInBall(double radius, RandomStream& random);

}  // namespace volalign
