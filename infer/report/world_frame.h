#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "infer/calib/result.h"

namespace volalign {

/// A frame of the user's in which the structure stands, for example a robot's base.
struct WorldFrame {
  std::string name;
  Pose world_from_structure = Pose::Identity();  ///< of the first capture
  /// Covariance of delta, see PerturbLeft, world frame, m and rad.
  Matrix6d covariance = Matrix6d::Zero();
  /// Root mean square, m, of what the fit leaves of the points or of the carrier's positions.
  std::optional<double> rms_m;
  /// The structure's pose in the frame of the robot's link that carries it.
  std::optional<Pose> carrier_from_structure;
};

/// A corner of a box, touched or measured in the world. `corner`: three signs, of the box's own x,
/// y and z, as "+-+".
struct TouchedPoint {
  std::string box, corner;
  Eigen::Vector3d xyz_m = Eigen::Vector3d::Zero();
};

/// The content of a file of --world (docs/world.md). One of the three is given.
struct WorldObservation {
  std::string name;
  std::optional<Pose> world_from_structure;
  std::vector<TouchedPoint> points;
  std::vector<Pose> world_from_carrier;  ///< of each capture
  double sigma_m = 0, sigma_deg = 0;     ///< of each pose; of points sigma_m alone
};

/// Throws IoError, or DataError unless the file has exactly one of the three and its sigmas.
WorldObservation ReadWorldObservation(const std::filesystem::path& path);

/// Finds the structure in the world.
///
/// Points: rigid alignment of the boxes' corners, as built, with the points (AlignPoints). Three
/// points that are not on one line are needed.
///
/// Carrier: with poses C_i of the carrier and T_i of the structure in the first capture's structure
/// frame, C_i X = W T_i. X and W by the relative motions (F. C. Park, B. J. Martin, Robot sensor
/// calibration: solving AX = XB on the Euclidean group, IEEE Trans. Robotics and Automation 10,
/// 1994), then by least squares with the covariances of C_i and T_i. Three captures are needed,
/// turned about two axes.
///
/// The covariance is multiplied by what the residuals show, if that is more than the sigmas say.
/// Throws ConfigError if the observation does not fit the captures or cannot determine the frame.
WorldFrame FindWorldFrame(const WorldObservation& observation, const CalibrationResult& result,
                          const Structure& structure);

/// Where the structure stands and how exactly, in one line.
std::string WorldSentence(const WorldFrame& world);

/// Covariance, in the world, of a pose that has `covariance` in the structure frame.
Matrix6d CovarianceInWorld(const WorldFrame& world, const Matrix6d& covariance);

}  // namespace volalign
