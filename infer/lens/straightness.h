#pragma once

// What large planes say about a lens: a wall that is seen through another lens than the intrinsics
// have is bent.

#include <Eigen/Core>
#include <vector>

#include "infer/lens/planes.h"
#include "infer/lens/sensor_lens.h"

namespace volalign {

/// The large planes that one sensor sees, the intrinsics that its view was made with, and how
/// depths of its kind err.
struct SensorPlanes {
  Intrinsics intrinsics;
  std::vector<LargePlane> planes;
  DepthErrorModel errors = ErrorsOf("");
};

/// Planes with what is known about their errors.
class WeighedPlanes;

/// The planes of sensors that share a lens. Of each plane the place is unknown, its points have
/// independent errors and a smooth one, whose size and correlation length are those under which its
/// bend is most probable (restricted likelihood). A surface that no lens makes flat is left out.
class Straightness {
 public:
  explicit Straightness(const std::vector<SensorPlanes>& sensors);
  ~Straightness();

  /// The change from `assumed` (of each sensor) under which the planes are most probably flat, from
  /// `start` on. They tell nothing about the focal length: it stays.
  LensEstimate Straighten(const std::vector<Intrinsics>& assumed,
                          const Eigen::Vector3d& prior_sigmas, const LensChange& start) const;

  /// What the planes say about the lens, linear at `change`.
  LensEvidence EvidenceAt(const std::vector<Intrinsics>& assumed, const LensChange& change) const;

 private:
  std::vector<WeighedPlanes> sensors_;
};

/// The farthest, m, that a further change moves a patch off its plane, the plane being fitted
/// again.
double LargestBend(const SensorPlanes& sensor, const LensChange& change);

}  // namespace volalign
