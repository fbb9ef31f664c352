#include "infer/initial/shape_check.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/odds.h"
#include "infer/initial/agreement.h"
#include "infer/initial/floor.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/side_patch.h"
#include "infer/initial/view_fit.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// A side is tilted if its measured plane differs from the pose's by more than this angle, rad (12
/// deg), and this many standard deviations. Smaller patches, m^2, say nothing.
constexpr double kTilted = 12 * kDegree, kTiltSigmas = 2, kLeastPatch = 0.02;

bool IsTilted(const SidePatch& patch, const Structure& structure,
              const Pose& structure_from_sensor) {
  const Eigen::Vector3d normal = structure_from_sensor.linear() * patch.normal;
  // A side seen edge-on may have its normal on either side.
  const double cosine = std::abs(normal.dot(structure.SideOfLabel(patch.label).normal));
  return patch.area > kLeastPatch &&
         std::acos(std::min(1.0, cosine)) > kTilted + kTiltSigmas * patch.normal_sigma;
}

}  // namespace

std::optional<double> ShapeLogOdds(const SensorView& view, const Structure& structure,
                                   const Pose& structure_from_sensor) {
  if (FindFloor(view, structure, structure_from_sensor).Floats()) return std::nullopt;
  const double log_odds =
      MeasureShape(LookAround(view, structure).surface, structure, structure_from_sensor).LogOdds();
  if (log_odds <= -std::log(kDecisiveOdds)) return std::nullopt;
  const std::vector<SidePatch> patches = CollectPatches(
      view,
      LabelsFromPose(view, structure, structure_from_sensor, SurfaceTolerance::AtPose(view.errors)),
      structure);
  const bool tilted = std::any_of(patches.begin(), patches.end(), [&](const SidePatch& patch) {
    return IsTilted(patch, structure, structure_from_sensor);
  });
  return tilted ? std::nullopt : std::optional<double>(log_odds);
}

}  // namespace volalign
