#include "infer/initial/pose_hypotheses.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "infer/depth/explain_view.h"
#include "infer/initial/agreement.h"
#include "infer/initial/floor.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

using Labellings = std::vector<const Labelling*>;

/// m: a pose is labelled again while its labels move it farther than this.
constexpr double kLabelsStay = 0.005;

std::vector<Hypothesis> OfLabellings(const std::vector<StructureSymmetry>& symmetries,
                                     const Labellings& labellings, bool known_up) {
  std::vector<Hypothesis> poses;
  for (std::size_t t = 0; t < labellings.size(); ++t) {
    if (!labellings[t]->initial.found) continue;
    const Pose& pose = labellings[t]->initial.structure_from_sensor;
    const int turns = known_up ? 0 : labellings[t]->turns;
    poses.push_back({pose, PoseSource::kNetwork, t, -1, turns});
    for (std::size_t a = 0; a < symmetries.size(); ++a) {
      if (symmetries[a].keeps_up() || !known_up)
        poses.push_back({symmetries[a].motion * pose, PoseSource::kNetwork, t, static_cast<int>(a),
                         (turns + (symmetries[a].keeps_up() ? 0 : 2)) % 4});
    }
  }
  return poses;
}

/// The turns of poses found by geometry follow from the side of the picture that is up, as compared
/// with a pose of the network.
void AddGeometry(const SensorView& view, const Structure& structure,
                 const std::vector<StructureSymmetry>& symmetries, bool known_up,
                 std::vector<Hypothesis>* poses) {
  const std::vector<Hypothesis> by_network = *poses;
  for (const GeometricPose& found : FindPosesByGeometry(view, structure, symmetries)) {
    const Pose& pose = found.structure_from_sensor;
    Hypothesis each{pose, PoseSource::kGeometry};
    if (!by_network.empty() && known_up &&
        std::all_of(by_network.begin(), by_network.end(), [&](const Hypothesis& other) {
          return TurnsOver(other.structure_from_sensor, pose);
        }))
      continue;
    if (!by_network.empty() && !known_up) {
      const Hypothesis& first = by_network.front();
      each.turns =
          (UprightTurns(pose) + first.turns + 4 - UprightTurns(first.structure_from_sensor)) % 4;
    }
    poses->push_back(each);
  }
}

double ByAllLabels(const ViewExplanation& view) {
  return view.LogOddsByLabels() + view.LogOddsByOutline();
}

}  // namespace

std::vector<Hypothesis> FindHypotheses(const SensorView& view, const Structure& structure,
                                       const std::vector<StructureSymmetry>& symmetries,
                                       const Labellings& labellings, bool known_up,
                                       PoseMethod method) {
  std::vector<Hypothesis> poses = OfLabellings(symmetries, labellings, known_up);
  if (method != PoseMethod::kNetwork) AddGeometry(view, structure, symmetries, known_up, &poses);
  WeighHypotheses(view, structure, labellings, &poses);
  return poses;
}

void WeighHypotheses(const SensorView& view, const Structure& structure,
                     const Labellings& labellings, std::vector<Hypothesis>* hypotheses) {
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const SensorView coarse = Decimate(view, stride);
  std::vector<SegmentationResult> coarse_labels;
  for (const Labelling* labelling : labellings)
    coarse_labels.push_back(Decimate(labelling->segmentation, stride));
  std::vector<Pose> poses;
  for (const Hypothesis& each : *hypotheses) poses.push_back(each.structure_from_sensor);
  const std::vector<FloorFit> floors = FindFloors(view, structure, poses);
  bool labels_speak = false;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    Hypothesis& each = (*hypotheses)[k];
    const auto explain = [&](const SegmentationResult* by) {
      return ExplainView(coarse, by, structure, poses[k], kRoughPose);
    };
    ViewExplanation best = explain(nullptr);
    each.by_floor = floors[k].LogOdds();
    each.by_depth = best.LogOddsByDepth();
    for (const SegmentationResult& labels : coarse_labels) {
      const ViewExplanation other = explain(&labels);
      if (other.has_labels() && (!best.has_labels() || ByAllLabels(other) > ByAllLabels(best)))
        best = other;
    }
    each.by_labels = best.LogOddsByLabels();
    each.by_outline = best.LogOddsByOutline();
    labels_speak = labels_speak || each.by_outline > 0;
  }
  if (labels_speak) return;
  for (Hypothesis& each : *hypotheses) each.by_labels = each.by_outline = 0;
}

LabelledPose LabelByPose(const SensorView& view, const Structure& structure, Pose pose) {
  LabelledPose labelled;
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(view.errors);
  for (int round = 0; round < kRounds; ++round) {
    labelled.segmentation = LabelsFromPose(view, structure, pose, tolerance);
    labelled.initial = EstimateInitialPose(view, labelled.segmentation, structure, &pose);
    if (!labelled.initial.found) break;
    const Pose before = std::exchange(pose, labelled.initial.structure_from_sensor);
    if (ComparePoses(before, pose).translation_m < kLabelsStay) break;
  }
  return labelled;
}

}  // namespace volalign
