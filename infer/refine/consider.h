#pragma once

// Depth errors of a frame that look like another pose. Not for callers of Refine.

#include <Eigen/Core>

#include "core/geometry/depth_error_model.h"

namespace volalign::refine_internal {

/// A frame's consider parameters (Schmidt, "Application of state-space methods to navigation
/// problems", 1966), which are not estimated: derivatives by them tell how far its pose may be off
/// for them. Tilts of the depth along rows and along columns, its twist, and bounced light
/// (DepthErrorModel::tilt_m, twist_m, bounce_m), each over its unit.
enum ConsiderParameter { kTiltRows, kTiltColumns, kTwist, kBounced, kConsiderParameters };
using ConsiderVector = Eigen::Matrix<double, kConsiderParameters, 1>;

/// Their standard deviations.
inline ConsiderVector ConsiderSigmas(const DepthErrorModel& errors) {
  return {errors.tilt_m, errors.tilt_m, errors.twist_m, errors.bounce_m};
}

/// By how many m each of them, at 1, adds to the depth of a point. Without bounced light, which
/// BouncedShare has.
inline ConsiderVector ConsideredAt(const DepthErrorModel& errors, const Eigen::Vector3d& p) {
  const Eigen::Vector2d bearing = p.head<2>() / p.z();
  return errors.TiltGrowth(p.z()) *
         ConsiderVector(bearing.x(), bearing.y(), bearing.x() * bearing.y(), 0);
}

}  // namespace volalign::refine_internal
