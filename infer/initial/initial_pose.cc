#include "infer/initial/initial_pose.h"

#include <optional>

#include "core/base/lists.h"
#include "infer/initial/agreement.h"
#include "infer/initial/pose_candidates.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: how far off a keypoint may be once a pose has been corrected for visibility.
constexpr double kMostOff = 2 * kRoughPose;

}  // namespace

InitialPose EstimateInitialPose(const SensorView& view, const SegmentationResult& segmentation,
                                const Structure& structure, const Pose* near) {
  InitialPose result;
  result.patches = CollectPatches(view, segmentation, structure);
  SortLargestFirst(&result.patches, [](const SidePatch& patch) { return patch.area; });
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const SensorView coarse = Decimate(view, stride);
  const SegmentationResult coarse_labels = Decimate(segmentation, stride);
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(view.errors);

  const auto correct = [&](const SensorView& by, double max_distance_m, const Pose& pose) {
    return CorrectForVisibility(by, result.patches, structure, max_distance_m, pose).value_or(pose);
  };

  double best = 0;
  for (const Pose& candidate :
       near ? std::vector<Pose>{*near} : FindCandidates(result.patches, structure)) {
    const Pose pose = correct(coarse, kMostKeypointError, candidate);
    if (near && !SamePose(structure, pose, *near)) continue;
    const double score = CompareWithView(coarse, coarse_labels, structure, pose, tolerance).score();
    if (result.found && !(score > best)) continue;
    result.found = true;
    result.structure_from_sensor = pose;
    best = score;
  }
  // Centroids on the decimated grid are a few millimetres off.
  if (result.found)
    result.structure_from_sensor = correct(view, kMostOff, result.structure_from_sensor);
  return result;
}

}  // namespace volalign
