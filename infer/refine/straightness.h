#pragma once

// What large planes say about a lens: a wall that is seen through another lens than the intrinsics
// have is bent.

#include <Eigen/Core>
#include <vector>

#include "infer/view/lens.h"
#include "infer/view/planes.h"

namespace volalign {

/// The large planes that one sensor sees, at a change from the intrinsics that are assumed.
struct SensorPlanes {
  Intrinsics assumed;
  LensChange at = LensChange::Zero();
  std::vector<LargePlane> planes;
};

/// The change under which the planes of all `sensors`, which share a lens, are most probably flat:
/// of each plane the place is unknown, its points have independent errors and a smooth one, whose
/// size and correlation length are those under which its bend is most probable (restricted
/// likelihood). A surface that no lens makes flat says nothing. Of the focal length planes tell
/// nothing: it stays.
LensEstimate StraightenPlanes(const std::vector<SensorPlanes>& sensors,
                              const Eigen::Vector3d& prior_sigmas);

/// What they say about the lens, linear at `change`.
LensEvidence PlaneEvidence(const std::vector<SensorPlanes>& sensors, const LensChange& change);

/// The farthest, m, that a further change moves a patch off its plane, the plane being fitted
/// again.
double LargestBend(const SensorPlanes& sensor, const LensChange& change);

}  // namespace volalign
