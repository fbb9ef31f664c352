#pragma once

#include <optional>
#include <string>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"

namespace volalign {

/// A sensor's pose for other programs.
struct SensorPose {
  std::string name;
  Pose structure_from_sensor = Pose::Identity();
  std::optional<Intrinsics> intrinsics = {};  ///< to which the pose belongs, if known
  std::optional<ColourCamera> colour = {};
  std::string serial = {};  ///< of the device; may be empty
  /// True depth = depth_gain * measured depth + depth_offset_m; the pose belongs to true depths.
  double depth_gain = 1, depth_offset_m = 0;
  /// Those of the capture, if known.
  std::optional<Intrinsics> intrinsics_given = {};

  bool corrects_depth() const { return depth_gain != 1 || depth_offset_m != 0; }
};

// Frames of other programs: p_other = ... * p_ours.

/// A world with z up instead of y: (x, y, z) -> (x, -z, y).
Eigen::Matrix3d ZUpFromYUp();
/// The left-handed world of Unity, y up: (x, y, z) -> (-x, y, z), as its glTF importers do.
Eigen::Matrix3d UnityFromYUp();
/// A camera of Unity, x right, y up, z forward, left-handed, from the sensor frame.
Eigen::Matrix3d UnityCameraFromSensor();
/// The camera space of the Kinect for Windows SDK 2.0: x left, y up, z forward.
Eigen::Matrix3d KinectV2FromSensor();

/// A pose from a rotation of limited precision. Throws DataError, with `what` in its message, if
/// the matrix is farther than 1e-3 from a rotation.
Pose PoseFromRotation(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation,
                      const std::string& what);
/// The same from a quaternion of about unit length, w first.
Pose PoseFromQuaternion(double w, double x, double y, double z, const Eigen::Vector3d& translation,
                        const std::string& what);

/// The quaternion of a rotation, with w >= 0.
Eigen::Quaterniond QuaternionOf(const Eigen::Matrix3d& rotation);

}  // namespace volalign
