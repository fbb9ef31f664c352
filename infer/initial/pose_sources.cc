#include "infer/initial/pose_sources.h"

#include <algorithm>

#include "core/base/lists.h"
#include "infer/initial/agreement.h"
#include "infer/initial/floor.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/same_pose.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Labels follow the pose that they led to while it moves farther than this, m.
constexpr double kLabelsStay = 0.005;
/// Agreement of a network's labels with the best pose that they lead to, below which they say
/// nothing: beyond the distances that it was trained for it labels the room (0.11 to 0.16 at 4 m).
constexpr double kSaysNothing = 0.25;

/// Which of both sources a pose comes from makes no difference: shape, floor and the network's
/// labels are compared at every one.
void ScoreAlike(const SensorView& view, const Structure& structure,
                const std::vector<PoseTrial>& trials, const InitialPoseOptions& initial,
                std::vector<PoseCandidate>* poses) {
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const SensorView coarse = Decimate(view, stride);
  const SensorSurface surface = PrepareSurface(view, structure);
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(view.errors);
  std::vector<ViewFit> shapes;
  std::vector<Pose> rivals;
  double reference = 0;
  for (const PoseCandidate& pose : *poses) {
    shapes.push_back(MeasureShape(surface, structure, pose.structure_from_sensor));
    reference = std::max(reference, shapes.back().explained);
    rivals.push_back(pose.structure_from_sensor);
  }
  const std::vector<FloorFit> floors = FindFloors(view, structure, rivals, initial.table_height_m);
  for (std::size_t k = 0; k < poses->size(); ++k) {
    PoseCandidate& pose = (*poses)[k];
    pose.shape_iou = shapes[k].shape_iou(reference);
    pose.floor = floors[k].share();
    pose.network_score = 0;
    for (const PoseTrial& trial : trials) {
      const Agreement agreement =
          CompareWithView(coarse, Decimate(*trial.segmentation, stride), structure,
                          pose.structure_from_sensor, initial.patch.min_confidence, tolerance);
      pose.network_score = std::max(pose.network_score, agreement.score());
    }
  }
}

}  // namespace

bool AsksNetwork(PoseMethod method, bool model) { return model && method != PoseMethod::kGeometry; }

bool AsksGeometry(PoseMethod method) {
  return method == PoseMethod::kAuto || method == PoseMethod::kGeometry;
}

std::vector<PoseCandidate> ProposeByGeometry(const SensorView& view, const Structure& structure,
                                             const std::vector<StructureAlias>& aliases,
                                             const InitialPoseOptions& options) {
  std::vector<PoseCandidate> proposals;
  std::vector<Pose> rivals;
  for (const GeometricPose& pose :
       FindPosesByGeometry(view, structure, aliases, options.table_height_m, options.geometry)) {
    PoseCandidate proposal;
    proposal.structure_from_sensor = pose.structure_from_sensor;
    proposal.source = PoseSource::kGeometry;
    proposal.shape_iou = proposal.network_score = pose.shape_iou;
    proposals.push_back(proposal);
    rivals.push_back(pose.structure_from_sensor);
  }
  const std::vector<FloorFit> floors = FindFloors(view, structure, rivals, options.table_height_m);
  for (std::size_t k = 0; k < proposals.size(); ++k) proposals[k].floor = floors[k].share();
  return proposals;
}

std::vector<PoseCandidate> CombineProposals(const SensorView& view, const Structure& structure,
                                            const std::vector<PoseTrial>& trials,
                                            std::vector<PoseCandidate> network,
                                            std::vector<PoseCandidate> geometry,
                                            const InitialPoseOptions& initial,
                                            const PoseChoiceOptions& options) {
  if (geometry.empty() || network.empty()) return geometry.empty() ? network : geometry;
  const PoseChoice choice = Decide(network, structure, options);
  const Pose& best =
      choice.found ? choice.best.structure_from_sensor : network.front().structure_from_sensor;
  // Between poses that the network cannot tell apart, the one that geometry happens to find is no
  // better: the rig decides, or nothing does.
  std::vector<Pose> known{best};
  if (choice.ambiguous) {
    for (const PoseCandidate& own : network) known.push_back(own.structure_from_sensor);
  }
  const bool agree = std::any_of(geometry.begin(), geometry.end(), [&](const PoseCandidate& found) {
    return std::any_of(known.begin(), known.end(), [&](const Pose& pose) {
      return SamePose(structure, found.structure_from_sensor, pose);
    });
  });
  if (agree) return network;
  if (!HasShape(MeasureShape(PrepareSurface(view, structure), structure, best), structure,
                initial.geometry)) {
    // Labels that fit no better there contradict geometry: a mirrored frame, a stack built
    // otherwise.
    std::vector<PoseCandidate> both = geometry;
    PoseCandidate own;
    own.structure_from_sensor = best;
    both.push_back(own);
    ScoreAlike(view, structure, trials, initial, &both);
    const double own_score = both.back().network_score;
    return own_score < kSaysNothing || both.front().network_score > own_score ? geometry : network;
  }
  network.insert(network.end(), geometry.begin(), geometry.end());
  ScoreAlike(view, structure, trials, initial, &network);
  DropMisfits(initial.geometry.rival_margin, &network);
  SortLargestFirst(&network, [](const PoseCandidate& pose) { return pose.shape_iou; });
  const PoseChoice together = Decide(network, structure, options);
  if (choice.found && !choice.ambiguous && together.found &&
      !SamePose(structure, together.best.structure_from_sensor, best)) {
    // The network alone was sure of another pose, and that has the structure's shape: the view does
    // not tell.
    PoseCandidate other = together.best;
    other.shape_iou = choice.best.shape_iou;
    other.floor = choice.best.floor;
    other.label_score = choice.best.label_score;
    other.network_score = choice.best.network_score;
    return {choice.best, other};
  }
  return network;
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
