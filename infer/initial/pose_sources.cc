#include "infer/initial/pose_sources.h"

#include <algorithm>

#include "infer/initial/agreement.h"
#include "infer/initial/geometry_search.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: a pose is labelled again while its labels move it farther than this.
constexpr double kLabelsStay = 0.005;

}  // namespace

bool AsksNetwork(PoseMethod method, bool model) { return model && method != PoseMethod::kGeometry; }

bool AsksGeometry(PoseMethod method) {
  return method == PoseMethod::kAuto || method == PoseMethod::kGeometry;
}

std::vector<PoseCandidate> FindCompetitors(const SensorView& view, const Structure& structure,
                                           const std::vector<StructureAlias>& aliases,
                                           const std::vector<PoseTrial>& trials, bool known_up,
                                           const InitialPoseOptions& initial) {
  std::vector<PoseCandidate> poses =
      PosesOfTrials(view, structure, aliases, trials, known_up, initial);
  if (AsksGeometry(initial.method)) {
    const std::vector<PoseCandidate> of_trials = poses;
    for (const GeometricPose& pose : FindPosesByGeometry(view, structure, aliases)) {
      if (known_up && !of_trials.empty() &&
          std::all_of(of_trials.begin(), of_trials.end(), [&](const PoseCandidate& other) {
            return TurnsOver(other.structure_from_sensor, pose.structure_from_sensor);
          })) {
        continue;
      }
      PoseCandidate proposal;
      proposal.structure_from_sensor = pose.structure_from_sensor;
      proposal.source = PoseSource::kGeometry;
      poses.push_back(proposal);
    }
  }
  WeighPoses(view, structure, aliases, trials, &poses);
  return poses;
}

LabelledPose LabelByPose(const SensorView& view, const Structure& structure, const Pose& pose,
                         const InitialPoseOptions& options) {
  LabelledPose labelled;
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(view.errors);
  Pose at = pose;
  for (int round = 0; round < kRounds; ++round) {
    labelled.segmentation = LabelsFromPose(view, structure, at, tolerance);
    labelled.initial = EstimateInitialPose(view, labelled.segmentation, structure, options, &at);
    if (!labelled.initial.found) break;
    const Pose before = std::exchange(at, labelled.initial.structure_from_sensor);
    if (ComparePoses(before, at).translation_m < kLabelsStay) break;
  }
  return labelled;
}

}  // namespace volalign
