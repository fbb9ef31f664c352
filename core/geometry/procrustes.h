#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/pose.h"

namespace volalign {

struct ProcrustesResult {
  Pose target_from_source = Pose::Identity();
  double rms = 0;  ///< weighted root mean square of |target - T source|, m
  /// Singular values of the centred, weighted target set, largest first. Each is divided by the
  /// square root of the total weight, so it is a root-mean-square extent, m.
  Eigen::Vector3d extents = Eigen::Vector3d::Zero();
};

/// Weighted rigid alignment (Kabsch 1976, Umeyama 1991 without scale): the proper rotation (det =
/// +1) and translation that minimise sum w |target - (R source + t)|^2. Empty `weights`: all 1.
/// Throws Error for fewer than one point, unequal sizes or a non-positive total weight.
ProcrustesResult AlignPoints(const std::vector<Eigen::Vector3d>& source,
                             const std::vector<Eigen::Vector3d>& target,
                             const std::vector<double>& weights = {});

/// Keypoints determine a pose if the second singular value of their centred set exceeds this (m,
/// unnormalised, unit weights), whatever their number. It is 0 for points on one line, as the
/// centres of three sides may be.
inline constexpr double kMinSecondSingularValue = 0.05;
double SecondSingularValue(const std::vector<Eigen::Vector3d>& points);

}  // namespace volalign
