#pragma once

// Depth errors that a whole frame has and that look like another pose.

#include <Eigen/Core>
#include <cmath>

#include "core/geometry/depth_error_model.h"
#include "core/geometry/structure.h"

namespace volalign {

/// Cosine of the angle (84 deg) between a ray and a surface's normal beyond which depths say little
/// of the surface.
inline constexpr double kGrazing = 0.1;

/// Tilts of the depth along rows and along columns, its twist, what shear adds, and bounced light
/// (DepthErrorModel::tilt_m, twist_m, shear_m, bounce_m), each over its unit.
enum FrameError { kTiltRows, kTiltColumns, kTwist, kShear, kBounced, kFrameErrors };
using FrameErrorVector = Eigen::Matrix<double, kFrameErrors, 1>;

/// Their root mean squares. Bounced light lies evenly between nothing and twice its mean.
inline FrameErrorVector FrameErrorSigmas(const DepthErrorModel& errors) {
  FrameErrorVector sigmas;
  sigmas << errors.tilt_m, errors.tilt_m, errors.twist_m, errors.shear_m,
      2 * errors.bounce_m / std::sqrt(3);
  return sigmas;
}

/// By how many m each of them, at 1, adds to the depth of a point p on a surface with this normal;
/// sensor frame. Without bounced light, which BouncedShare has. Shear: rows of a stereo pair that
/// do not meet by d are matched with a shift of d S_xy / S_xx along them, where S is the structure
/// tensor of the picture, which for a texture without direction is the first fundamental form of
/// the surface over the picture.
FrameErrorVector FrameErrorsAt(const DepthErrorModel& errors, const Eigen::Vector3d& p,
                               const Eigen::Vector3d& normal);

/// m, from a point at q on a side to the nearest concave seam of its plane: where another box, or
/// the floor, rises in front of it. kNoSeam where none does. Structure frame.
double SeamDistance(const Structure& structure, const Side& side, const Eigen::Vector3d& q);
inline constexpr double kNoSeam = 8;

/// The floor, as a side of no box.
Side FloorOf(const Structure& structure);

/// By what share of DepthErrorModel::bounce_m light that comes by the floor and by other boxes adds
/// to the depth of a point q of a side, for a sensor with its lamp at `eye`; structure frame. Each
/// of these surfaces adds x exp(1 - x), x being its distance over `reach` (bounce_reach_m; of a
/// box three quarters of that; at the seam itself the way is no longer), times the cosine at which
/// it is lit at `reach` before the side. The sum is divided by the cosine at which the side is
/// seen: light that comes straight falls with it (Lambert), bounced light does not. Tops get more,
/// since walls and ceilings light them, too.
double BouncedShare(const Structure& structure, const Side& side, const Eigen::Vector3d& q,
                    const Eigen::Vector3d& eye, double reach);

}  // namespace volalign
