#include "infer/initial/pose_choice.h"

#include <algorithm>
#include <utility>

#include "core/base/lists.h"
#include "infer/initial/agreement.h"
#include "infer/initial/floor.h"
#include "infer/initial/relabel.h"
#include "infer/initial/same_pose.h"

namespace volalign {

namespace {

/// Of the margin between ShapeIou::ratio, before the poses are estimated again, which may improve
/// them.
constexpr double kFirstMargins = 2;
/// Cosine of the angle between two verticals (60 deg) below which one pose turns the structure
/// over.
constexpr double kTurnedOver = 0.5;

constexpr Words<PoseSource, 3> kSources = {{{"network", PoseSource::kNetwork},
                                            {"geometry", PoseSource::kGeometry},
                                            {"neighbours", PoseSource::kNeighbours}}};

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

/// A trial's labels, renamed as the pose's alias has them.
SegmentationResult ImpliedLabels(const PoseCandidate& pose,
                                 const std::vector<SegmentationResult>& labels,
                                 const std::vector<StructureAlias>& aliases) {
  const SegmentationResult& own = labels[pose.trial];
  return pose.alias < 0 ? own : Relabelled(own, aliases[static_cast<std::size_t>(pose.alias)]);
}

double Overlap(const PoseCandidate& pose, const DecimatedTrials& coarse, const Structure& structure,
               const InitialPoseOptions& options) {
  return MeasureShapeIou(coarse.view, coarse.labels[pose.trial], structure,
                         pose.structure_from_sensor, options.patch.min_confidence)
      .ratio();
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
                  options.patch.min_confidence, &labels);
  const InitialPose again =
      EstimateInitialPose(coarse.view, labels, structure, options, &pose.structure_from_sensor);
  return again.found ? again.structure_from_sensor : pose.structure_from_sensor;
}

/// Where labels are mixed up, few sides agree on a pose, and it may be tilted by degrees. Therefore
/// every pose is estimated again before it is judged, once for all that are about the same.
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

/// The labels at the pose.
void ScoreLabels(const DecimatedTrials& coarse, const Structure& structure,
                 const std::vector<StructureAlias>& aliases, const InitialPoseOptions& initial,
                 PoseCandidate* pose) {
  const SurfaceTolerance tolerance = SurfaceTolerance::AtRoughPose(coarse.view.errors);
  const auto score = [&](const SegmentationResult& labels) {
    return CompareWithView(coarse.view, labels, structure, pose->structure_from_sensor,
                           initial.patch.min_confidence, tolerance)
        .score();
  };
  for (const SegmentationResult& labels : coarse.labels)
    pose->network_score = std::max(pose->network_score, score(labels));
  pose->label_score = score(ImpliedLabels(*pose, coarse.labels, aliases));
}

/// Of the poses that stand on a floor as well as any does, the one with the best network score.
const PoseCandidate* BestStanding(const std::vector<PoseCandidate>& poses, double min_floor) {
  const PoseCandidate* best = nullptr;
  for (const PoseCandidate& pose : poses) {
    if (pose.floor > min_floor && (!best || pose.network_score > best->network_score)) best = &pose;
  }
  return best;
}

}  // namespace

const char* ToString(PoseSource source) { return WordOf(kSources, source); }

std::vector<PoseSource> AllOf(PoseSource) { return ValuesOf(kSources); }

bool TurnsOver(const Pose& from, const Pose& to) {
  return (to * from.inverse()).linear()(1, 1) < kTurnedOver;
}

std::vector<PoseCandidate> ListCompetitors(const std::vector<PoseTrial>& trials,
                                           const std::vector<StructureAlias>& aliases,
                                           bool known_up, const PoseChoiceOptions& options) {
  double best_score = 0;
  for (const PoseTrial& trial : trials) {
    if (trial.initial->found) best_score = std::max(best_score, trial.initial->agreement.score());
  }
  std::vector<PoseCandidate> poses;
  for (std::size_t t = 0; t < trials.size(); ++t) {
    const InitialPose& initial = *trials[t].initial;
    if (!initial.found || initial.agreement.score() < options.rival_score * best_score) continue;
    PoseCandidate pose;
    pose.trial = t;
    pose.structure_from_sensor = initial.structure_from_sensor;
    poses.push_back(pose);
    for (std::size_t a = 0; a < aliases.size(); ++a) {
      if (known_up && !aliases[a].keeps_up()) continue;
      pose.alias = static_cast<int>(a);
      pose.structure_from_sensor = aliases[a].motion * initial.structure_from_sensor;
      poses.push_back(pose);
    }
  }
  return poses;
}

void DropMisfits(double margin, std::vector<PoseCandidate>* poses) {
  double best = 0;
  for (const PoseCandidate& pose : *poses) best = std::max(best, pose.shape_iou);
  const auto misfit = [&](const PoseCandidate& pose) { return pose.shape_iou < best - margin; };
  poses->erase(std::remove_if(poses->begin(), poses->end(), misfit), poses->end());
}

PoseChoice Decide(const std::vector<PoseCandidate>& poses, const Structure& structure,
                  const PoseChoiceOptions& options) {
  PoseChoice choice;
  double min_floor = -2 - options.floor_margin;
  for (const PoseCandidate& pose : poses)
    min_floor = std::max(min_floor, pose.floor - options.floor_margin);
  const PoseCandidate* chosen = BestStanding(poses, min_floor);
  if (!chosen) return choice;
  choice.found = true;
  choice.best = *chosen;
  const Pose& chosen_pose = chosen->structure_from_sensor;
  // Labels decide where they speak clearly for the best pose, but they do not tell up from down.
  const auto labels_decide = [&](const PoseCandidate& other) {
    return !TurnsOver(chosen_pose, other.structure_from_sensor) &&
           choice.best.network_score - other.network_score >= options.score_margin;
  };
  for (const PoseCandidate& pose : poses) {
    if (SamePose(structure, pose.structure_from_sensor, chosen_pose)) {
      if (pose.label_score <= choice.best.label_score) continue;
      const double network_score = choice.best.network_score;
      choice.best = pose;
      choice.best.network_score = std::max(network_score, pose.network_score);
    } else if (pose.floor > min_floor && !labels_decide(pose) &&
               !(choice.ambiguous && choice.rival.network_score >= pose.network_score)) {
      choice.ambiguous = true;
      choice.rival = pose;
    }
  }
  return choice;
}

std::vector<PoseCandidate> FindCompetitors(const SensorView& view, const Structure& structure,
                                           const std::vector<StructureAlias>& aliases,
                                           const std::vector<PoseTrial>& trials, bool known_up,
                                           const InitialPoseOptions& initial,
                                           const PoseChoiceOptions& options) {
  std::vector<PoseCandidate> poses = ListCompetitors(trials, aliases, known_up, options);
  if (poses.empty()) return {};
  const DecimatedTrials coarse = DecimateTrials(view, trials);
  for (PoseCandidate& pose : poses) pose.shape_iou = Overlap(pose, coarse, structure, initial);
  DropMisfits(kFirstMargins * options.shape_iou_margin, &poses);
  SortLargestFirst(&poses, [](const PoseCandidate& pose) { return pose.shape_iou; });

  EstimateAllAgain(coarse, structure, aliases, initial, &poses);
  for (PoseCandidate& pose : poses) pose.shape_iou = Overlap(pose, coarse, structure, initial);
  DropMisfits(options.shape_iou_margin, &poses);

  std::vector<Pose> rivals;
  for (const PoseCandidate& pose : poses) rivals.push_back(pose.structure_from_sensor);
  const std::vector<FloorFit> floors = FindFloors(view, structure, rivals, initial.table_height_m);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    poses[k].floor = floors[k].share();
    ScoreLabels(coarse, structure, aliases, initial, &poses[k]);
  }
  return poses;
}

}  // namespace volalign
