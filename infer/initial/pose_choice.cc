#include "infer/initial/pose_choice.h"

#include <algorithm>
#include <utility>

#include "infer/depth/explain_view.h"
#include "infer/initial/floor.h"
#include "infer/initial/relabel.h"
#include "infer/initial/same_pose.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Cosine of the angle between two verticals (60 deg) below which one pose turns the structure
/// over.
constexpr double kTurnedOver = 0.5;

/// The frame and each trial's labels with fewer rays.
struct DecimatedTrials {
  SensorView view;
  std::vector<SegmentationResult> labels;  // of each trial
};

DecimatedTrials DecimateTrials(const SensorView& view, const std::vector<PoseTrial>& trials) {
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  DecimatedTrials decimated{Decimate(view, stride), {}};
  for (const PoseTrial& trial : trials)
    decimated.labels.push_back(Decimate(*trial.segmentation, stride));
  return decimated;
}

/// A trial's labels, renamed by the pose's symmetry.
SegmentationResult ImpliedLabels(const PoseCandidate& pose,
                                 const std::vector<SegmentationResult>& labels,
                                 const std::vector<StructureAlias>& aliases) {
  const SegmentationResult& own = labels[pose.trial];
  return pose.alias < 0 ? own : Relabelled(own, aliases[static_cast<std::size_t>(pose.alias)]);
}

/// The pose, estimated again with the labels that it implies.
Pose EstimateAgain(const PoseCandidate& pose, const DecimatedTrials& coarse,
                   const Structure& structure, const std::vector<StructureAlias>& aliases,
                   const InitialPoseOptions& options) {
  SegmentationResult labels = ImpliedLabels(pose, coarse.labels, aliases);
  std::vector<const SegmentationResult*> others;
  for (std::size_t t = 0; t < coarse.labels.size(); ++t) {
    if (t != pose.trial) others.push_back(&coarse.labels[t]);
  }
  ReconcileLabels(coarse.view, structure, aliases, pose.structure_from_sensor, others,
                  kLeastConfidence, &labels);
  const InitialPose again =
      EstimateInitialPose(coarse.view, labels, structure, options, &pose.structure_from_sensor);
  return again.found ? again.structure_from_sensor : pose.structure_from_sensor;
}

/// Where labels are mixed up, few sides agree on a pose, and it may be tilted by degrees. Every
/// pose is therefore estimated again before it is judged, once for all that are about the same.
void EstimateAllAgain(const DecimatedTrials& coarse, const Structure& structure,
                      const std::vector<StructureAlias>& aliases, const InitialPoseOptions& options,
                      std::vector<PoseCandidate>* poses) {
  std::vector<std::pair<Pose, Pose>> known;  // before and after
  for (PoseCandidate& pose : *poses) {
    const Pose before = pose.structure_from_sensor;
    const auto same = std::find_if(known.begin(), known.end(), [&](const auto& pair) {
      return SamePose(structure, pair.first, before);
    });
    if (same != known.end()) {
      pose.structure_from_sensor = same->second;
    } else {
      pose.structure_from_sensor = EstimateAgain(pose, coarse, structure, aliases, options);
      known.emplace_back(before, pose.structure_from_sensor);
    }
  }
}

double ByAllLabels(const ViewExplanation& view) {
  return view.LogOddsByLabels() + view.LogOddsByOutline();
}

}  // namespace

bool TurnsOver(const Pose& from, const Pose& to) {
  return (to * from.inverse()).linear()(1, 1) < kTurnedOver;
}

std::vector<PoseCandidate> PosesOfTrials(const SensorView& view, const Structure& structure,
                                         const std::vector<StructureAlias>& aliases,
                                         const std::vector<PoseTrial>& trials, bool known_up,
                                         const InitialPoseOptions& initial) {
  std::vector<PoseCandidate> poses;
  for (std::size_t t = 0; t < trials.size(); ++t) {
    if (!trials[t].initial->found) continue;
    PoseCandidate pose;
    pose.trial = t;
    pose.structure_from_sensor = trials[t].initial->structure_from_sensor;
    poses.push_back(pose);
    for (std::size_t a = 0; a < aliases.size(); ++a) {
      if (known_up && !aliases[a].keeps_up()) continue;
      pose.alias = static_cast<int>(a);
      pose.structure_from_sensor = aliases[a].motion * trials[t].initial->structure_from_sensor;
      poses.push_back(pose);
    }
  }
  if (!poses.empty())
    EstimateAllAgain(DecimateTrials(view, trials), structure, aliases, initial, &poses);
  return poses;
}

void WeighPoses(const SensorView& view, const Structure& structure,
                const std::vector<StructureAlias>& aliases, const std::vector<PoseTrial>& trials,
                std::vector<PoseCandidate>* poses) {
  const DecimatedTrials coarse = DecimateTrials(view, trials);
  std::vector<Pose> rivals;
  for (const PoseCandidate& pose : *poses) rivals.push_back(pose.structure_from_sensor);
  const std::vector<FloorFit> floors = FindFloors(view, structure, rivals);
  for (std::size_t k = 0; k < poses->size(); ++k) {
    PoseCandidate& pose = (*poses)[k];
    const auto explain = [&](const SegmentationResult* labels) {
      return ExplainView(coarse.view, labels, structure, pose.structure_from_sensor, kRoughPose,
                         kLeastConfidence);
    };
    pose.by_floor = floors[k].LogOdds();
    ViewExplanation best = explain(nullptr);
    pose.by_depth = best.LogOddsByDepth();
    for (const SegmentationResult& labels : coarse.labels) {
      const ViewExplanation other = explain(&labels);
      if (other.has_labels() && (!best.has_labels() || ByAllLabels(other) > ByAllLabels(best)))
        best = other;
    }
    pose.by_labels = best.LogOddsByLabels();
    pose.by_outline = best.LogOddsByOutline();
    if (pose.source == PoseSource::kNetwork) {
      const SegmentationResult own = ImpliedLabels(pose, coarse.labels, aliases);
      pose.by_own_labels = explain(&own).LogOddsByLabels();
    }
  }
  const bool labels_speak = std::any_of(
      poses->begin(), poses->end(), [](const PoseCandidate& pose) { return pose.by_outline > 0; });
  if (labels_speak) return;
  for (PoseCandidate& pose : *poses) pose.by_labels = pose.by_outline = 0;
}

}  // namespace volalign
