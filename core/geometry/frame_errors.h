#pragma once

// Depth errors of a whole frame that resemble another pose.

#include <Eigen/Core>
#include <cmath>

#include "core/geometry/depth_error_model.h"
#include "core/geometry/structure.h"

namespace volalign {

/// Least cosine (84 deg) between a ray and a surface's normal for useful depths.
inline constexpr double kGrazing = 0.1;

/// Tilts of the depth along rows and along columns, shear, and multipath (DepthErrorModel::tilt_m,
/// shear_m, bounce_m), each divided by its unit.
enum FrameError { kTiltRows, kTiltColumns, kShear, kDiffuseMultipath, kFrameErrors };
using FrameErrorVector = Eigen::Matrix<double, kFrameErrors, 1>;

/// Root mean squares of these errors. Multipath is distributed evenly from 0 to twice its mean.
inline FrameErrorVector FrameErrorSigmas(const DepthErrorModel& errors) {
  FrameErrorVector sigmas;
  sigmas << errors.tilt_m, errors.tilt_m, errors.shear_m, 2 * errors.bounce_m / std::sqrt(3);
  return sigmas;
}

/// Derivative, m, of the depth of a point p on a surface with this normal by each of them; sensor
/// frame. It is 0 for multipath, see DiffuseMultipathShare. Shear: rows of a stereo pair that miss
/// each other by d are matched with a shift of d S_xy / S_xx along them. S is the structure tensor
/// of the picture. For a texture without direction, it is the first fundamental form of the surface
/// over the picture.
FrameErrorVector FrameErrorsAt(const DepthErrorModel& errors, const Eigen::Vector3d& p,
                               const Eigen::Vector3d& normal);

/// Distance, m, from a point q on a side to the nearest concave seam of its plane. At a seam,
/// another box or the floor rises in front of the side. kNoSeam if there is none. Structure frame.
double SeamDistance(const Structure& structure, const Side& side, const Eigen::Vector3d& q);
inline constexpr double kNoSeam = 8;

/// The floor, as a side of no box.
Side FloorOf(const Structure& structure);

/// Share of DepthErrorModel::bounce_m that multipath by the floor and other boxes adds to the depth
/// of a point q of a side. The sensor has its lamp at `eye`; structure frame. Each of these
/// surfaces adds x exp(1 - x), where x is its distance over `reach` (bounce_reach_m; three quarters
/// of it for a box). At the seam itself the way is no longer. The factor is the cosine at which the
/// surface is lit at `reach` before the side. The sum is divided by the cosine at which the side is
/// seen: direct light falls with it (Lambert), multipath does not. Tops get more, since walls and
/// ceilings light them, too.
double DiffuseMultipathShare(const Structure& structure, const Side& side, const Eigen::Vector3d& q,
                             const Eigen::Vector3d& eye, double reach);

}  // namespace volalign
