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

/// A side is tilted whose plane, as it was measured, is so far from the pose's, rad (12 deg), and
/// by so many standard deviations more; m^2: smaller patches say nothing.
constexpr double kTilted = 12 * kDegree, kTiltSigmas = 2, kLeastPatch = 0.02;

bool IsTilted(const SidePatch& patch, const Structure& structure,
              const Pose& structure_from_sensor) {
  const Eigen::Vector3d normal = structure_from_sensor.linear() * patch.normal;
  // The normal of a side that is seen edge-on may come out on either side of it.
  const double cosine = std::abs(normal.dot(structure.SideOfLabel(patch.label).normal));
  return patch.area > kLeastPatch &&
         std::acos(std::min(1.0, cosine)) > kTilted + kTiltSigmas * patch.normal_sigma;
}

}  // namespace

std::optional<double> ShapeLogOdds(const SensorView& view, const Structure& structure,
                                   const Pose& structure_from_sensor) {
  if (FindFloor(view, structure, structure_from_sensor).Floats()) return std::nullopt;
  const double log_odds =
      MeasureShape(PrepareSurface(view, structure), structure, structure_from_sensor).LogOdds();
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
