#pragma once

// Evidence of large planes about a lens: through wrong intrinsics, a wall is bent.

#include <Eigen/Core>
#include <vector>

#include "infer/lens/planes.h"
#include "infer/lens/sensor_lens.h"

namespace volalign {

/// The large planes of one sensor, the intrinsics of its view, and the depth errors of its kind.
struct SensorPlanes {
  Intrinsics intrinsics;
  std::vector<LargePlane> planes;
  DepthErrorModel errors = ErrorsOf("");
};

/// A plane with what is known about its errors.
class WeighedPlane;

/// The planes of sensors that share a lens. The place of each plane is unknown. Its points have
/// independent errors and a smooth one. The smooth error's size and correlation length make the
/// bend most probable (restricted likelihood). A surface that no lens makes flat is left out.
class Straightness {
 public:
  explicit Straightness(const std::vector<SensorPlanes>& sensors);
  ~Straightness();

  /// The change from `assumed` (of each sensor) under which the planes are most probably flat,
  /// beginning at `start`. The focal length stays, as planes do not determine it.
  LensEstimate Straighten(const std::vector<Intrinsics>& assumed,
                          const Eigen::Vector3d& prior_sigmas, const LensChange& start) const;

  /// The planes' evidence about the lens, linear at `change`.
  LensEvidence EvidenceAt(const std::vector<Intrinsics>& assumed, const LensChange& change) const;

 private:
  std::vector<std::vector<WeighedPlane>> sensors_;
};

/// The farthest, m, that a further change moves a patch off its plane, with the plane fitted again.
double LargestBend(const SensorPlanes& sensor, const LensChange& change);

}  // namespace volalign
