#pragma once

#include <limits>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"

namespace volalign {

struct RayHit {
  int side = -1;  ///< index into Structure::sides(), -1 when nothing is hit
  double t = std::numeric_limits<double>::infinity();  ///< point = origin + t * direction
};

/// First hit of a ray with the structure's parts from outside, t > 0: a slab test in each box's
/// frame, Embree for meshes.
RayHit CastRay(const Structure& structure, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& direction);

struct ExpectedView {
  DepthImage depth;   ///< z in metres, 0 where no part is hit
  LabelImage labels;  ///< 0 on sides without label and where no part is hit
};

/// The view of the structure alone from a sensor at `structure_from_sensor`. Needs no GL context.
ExpectedView CastView(const Structure& structure, const RayTable& rays,
                      const Pose& structure_from_sensor);

/// Distance from p (structure frame) to the nearest point of the finite sides, m, and
/// that side's index.
struct SurfaceDistance {
  double distance = std::numeric_limits<double>::infinity();
  int side = -1;
};
SurfaceDistance DistanceToSurface(const Structure& structure, const Eigen::Vector3d& p);

/// Points on the exposed surface that has labels, on a grid of `spacing` m (paper, Results: the set
/// B).
std::vector<Eigen::Vector3d> SampleExposedSurface(const Structure& structure, double spacing);

}  // namespace volalign
