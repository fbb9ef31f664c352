#include "infer/initial/initial_pose.h"

#include <algorithm>
#include <optional>

#include "infer/initial/paper_pose.h"
#include "infer/initial/pose_candidates.h"
#include "infer/initial/same_pose.h"
#include "infer/initial/visibility_correction.h"

namespace volalign {

namespace {

/// Corrections with every pixel that follow those on the decimated view, at most.
constexpr int kFullCorrections = 3;

/// Corrects a pose for visibility at most `iterations` times. Keypoints have to agree
/// `first_tightening` times better than options.max_keypoint_error_m in the first correction, and
/// better in each further one, up to kTightening times.
Pose CorrectForVisibility(const SensorView& view, const std::vector<SidePatch>& patches,
                          const Structure& structure, const InitialPoseOptions& options,
                          int first_tightening, int iterations, Pose pose) {
  for (int i = 0; i < iterations; ++i) {
    const double max_distance =
        options.max_keypoint_error_m / std::min(first_tightening + i, kTightening);
    const std::optional<Pose> next =
        CorrectOnceForVisibility(view, patches, structure, options, max_distance, pose);
    if (!next) break;
    pose = *next;
  }
  return pose;
}

InitialPose SearchPose(const SensorView& view, const SegmentationResult& segmentation,
                       const Structure& structure, const InitialPoseOptions& options,
                       const Pose* near) {
  InitialPose result;
  result.patches = LargestPatches(CollectPatches(view, segmentation, structure, options.patch));
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const SensorView coarse = Decimate(view, stride);
  const SegmentationResult coarse_labels = Decimate(segmentation, stride);
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(view.errors);
  const auto compare = [&](const Pose& pose) {
    return CompareWithView(coarse, coarse_labels, structure, pose, options.patch.min_confidence,
                           tolerance);
  };

  std::vector<Pose> candidates = FindCandidates(result.patches, structure, options, near);
  if (near) candidates.push_back(*near);
  for (const Pose& candidate : candidates) {
    const Pose pose = CorrectForVisibility(coarse, result.patches, structure, options, 1,
                                           options.visibility_iterations, candidate);
    if (near && !SamePose(structure, pose, *near)) continue;
    const Agreement agreement = compare(pose);
    if (result.found && !(agreement.score() > result.agreement.score())) continue;
    result.found = true;
    result.structure_from_sensor = pose;
    result.agreement = agreement;
  }
  if (!result.found) return result;
  // Centroids on the decimated grid are a few millimetres off.
  result.structure_from_sensor = CorrectForVisibility(
      view, result.patches, structure, options, kTightening,
      std::min(options.visibility_iterations, kFullCorrections), result.structure_from_sensor);
  result.agreement = compare(result.structure_from_sensor);
  return result;
}

}  // namespace

InitialPose EstimateInitialPose(const SensorView& view, const SegmentationResult& segmentation,
                                const Structure& structure, const InitialPoseOptions& options,
                                const Pose* near) {
  return options.method == PoseMethod::kPaper
             ? EstimatePaperPose(view, segmentation, structure, options)
             : SearchPose(view, segmentation, structure, options, near);
}

}  // namespace volalign
