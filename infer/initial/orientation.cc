#include "infer/initial/orientation.h"

#include <algorithm>
#include <utility>

#include "core/base/parallel_for.h"
#include "infer/initial/aliases.h"
#include "infer/initial/orientation_trials.h"
#include "infer/initial/pose_sources.h"
#include "infer/initial/relabel.h"
#include "infer/initial/rig_choice.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

namespace {

using pose_internal::BestTrial;
using pose_internal::LabelContext;
using pose_internal::OrientationTrial;
using pose_internal::Settled;

/// Turns into the network's orientation at a pose that a trial led to.
int TurnsAt(const LabelContext& context, const OrientationTrial& trial, const PoseCandidate& pose) {
  const bool over =
      pose.alias >= 0 && !context.aliases[static_cast<std::size_t>(pose.alias)].keeps_up();
  return (trial.turns + (over ? 2 : 0)) % 4;
}

/// The labels that suit a pose chosen among orientations and symmetries, and the initial pose that
/// follows from them.
void TakeChoice(const LabelContext& context, const LabelRequest& from, const PoseCandidate& choice,
                const std::vector<OrientationTrial*>& trials, const OrientationTrial& trial,
                Labelled* out) {
  if (choice.alias >= 0) {
    const StructureAlias& alias = context.aliases[static_cast<std::size_t>(choice.alias)];
    out->quarter_turns = TurnsAt(context, trial, choice);
    out->segmentation = Relabelled(std::move(out->segmentation), alias);
  }
  const Pose& pose = choice.structure_from_sensor;
  std::vector<const SegmentationResult*> others;
  for (const OrientationTrial* other : trials) {
    if (other != &trial) others.push_back(&other->segmentation);
  }
  ReconcileLabels(*from.view, context.structure, context.aliases, pose, others, kLeastConfidence,
                  &out->segmentation);
  out->initial =
      EstimateInitialPose(*from.view, out->segmentation, context.structure, context.initial, &pose);
}

/// A pose that geometry has found, with the labels that it implies. No network tells the turns:
/// they are the frame's own, or put the floor at the bottom.
void TakeGeometry(const LabelContext& context, const LabelRequest& from, const Pose& pose,
                  Labelled* out) {
  LabelledPose labelled = LabelByPose(*from.view, context.structure, pose, context.initial);
  out->segmentation = std::move(labelled.segmentation);
  out->initial = std::move(labelled.initial);
  out->source = PoseSource::kGeometry;
  out->quarter_turns = from.quarter_turns == kAutoTurns ? UprightTurns(pose) : from.quarter_turns;
}

/// The trial of the only orientation that is beyond doubt; null where there is none or several.
const OrientationTrial* OnlySettled(const std::vector<OrientationTrial*>& trials) {
  const OrientationTrial* only = nullptr;
  for (const OrientationTrial* trial : trials) {
    if (!Settled(*trial)) continue;
    if (only) return nullptr;
    only = trial;
  }
  return only;
}

/// The poses that compete for a view, over all orientations and symmetries, by the network and by
/// geometry. If labels and depths settle one orientation alone, there is only its pose, and
/// geometry is not asked.
std::vector<PoseCandidate> Competitors(const LabelContext& context, std::size_t i,
                                       const std::vector<OrientationTrial*>& trials) {
  const LabelRequest& from = context.views[i];
  if (!from.usable || context.initial.method == PoseMethod::kPaper) return {};
  if (from.known) {
    PoseCandidate pose;
    pose.structure_from_sensor = *from.known;
    pose.source = PoseSource::kGeometry;
    return {pose};
  }
  if (const OrientationTrial* only = OnlySettled(trials)) {
    PoseCandidate pose;
    pose.structure_from_sensor = only->initial.structure_from_sensor;
    pose.trial =
        static_cast<std::size_t>(std::find(trials.begin(), trials.end(), only) - trials.begin());
    return {pose};
  }
  std::vector<PoseTrial> poses;
  poses.reserve(trials.size());
  for (const OrientationTrial* t : trials) poses.push_back({&t->segmentation, &t->initial});
  return FindCompetitors(*from.view, context.structure, context.aliases, poses,
                         from.quarter_turns != kAutoTurns, context.initial);
}

/// The turns of each competing pose. Empty where they are given, or where no pose is the network's.
/// The turns of a pose found by geometry follow from the side of the picture that is up.
std::vector<int> TurnsOf(const LabelContext& context, std::size_t i,
                         const std::vector<OrientationTrial*>& trials,
                         const std::vector<PoseCandidate>& poses) {
  const auto by_network = std::find_if(poses.begin(), poses.end(), [](const PoseCandidate& pose) {
    return pose.source == PoseSource::kNetwork;
  });
  if (context.views[i].quarter_turns != kAutoTurns || by_network == poses.end()) return {};
  const int beside_upright = TurnsAt(context, *trials[by_network->trial], *by_network) + 4 -
                             UprightTurns(by_network->structure_from_sensor);
  std::vector<int> turns;
  for (const PoseCandidate& pose : poses) {
    turns.push_back(pose.source == PoseSource::kNetwork
                        ? TurnsAt(context, *trials[pose.trial], pose)
                        : (UprightTurns(pose.structure_from_sensor) + beside_upright) % 4);
  }
  return turns;
}

/// Chooses for all views together.
std::vector<PoseChoice> ChooseAll(const LabelContext& context,
                                  const std::vector<std::vector<OrientationTrial*>>& trials,
                                  const std::vector<std::vector<PoseCandidate>>& competitors) {
  std::vector<SensorCandidates> sensors(competitors.size());
  for (std::size_t i = 0; i < competitors.size(); ++i) {
    sensors[i] = {context.views[i].view, competitors[i],
                  TurnsOf(context, i, trials[i], competitors[i]), context.views[i].chosen,
                  context.views[i].prior};
  }
  return ChooseTogether(sensors, context.structure);
}

/// A view's chosen pose, with the labels that suit it. Without a choice that can be trusted, it is
/// the pose of the orientation that fits and stands on the floor best.
Labelled TakePose(const LabelContext& context, std::size_t i,
                  const std::vector<OrientationTrial*>& trials, const PoseChoice& choice) {
  const LabelRequest& from = context.views[i];
  Labelled out;
  if (from.known) return out;
  out.up_unknown = choice.up_unknown;
  out.alternatives = choice.alternatives;
  out.given = choice.given;
  if (choice.ambiguous) {
    out.other_pose =
        DescribeMotion(choice.best.structure_from_sensor, choice.rival.structure_from_sensor);
    out.floor_would_tell =
        LeavesFloor(choice.best.structure_from_sensor, choice.rival.structure_from_sensor);
  }
  if (choice.found && choice.best.source == PoseSource::kGeometry) {
    TakeGeometry(context, from, choice.best.structure_from_sensor, &out);
    return out;
  }
  if (trials.empty()) {
    out.segmentation = {LabelImage(from.view->width(), from.view->height()),
                        Image<float>(from.view->width(), from.view->height())};
    out.source = PoseSource::kGeometry;
    return out;
  }
  const PoseCandidate& best = choice.best;
  const bool settled = choice.found && best.alias < 0 && Settled(*trials[best.trial]);
  // By renamed sides, other things can be made to look like a structure.
  const bool trusted =
      settled || (choice.found && best.by_depth + best.by_outline + best.by_own_labels >= 0);
  const OrientationTrial& trial = trusted ? *trials[best.trial] : *BestTrial(trials);
  out.quarter_turns = trial.turns;
  out.segmentation = trial.segmentation;
  out.initial = trial.initial;
  if (trusted && !settled) TakeChoice(context, from, best, trials, trial, &out);
  return out;
}

}  // namespace

std::vector<Labelled> LabelViews(const std::vector<LabelRequest>& views, const Structure& structure,
                                 Segmenter* segmenter, const InitialPoseOptions& initial,
                                 const OrientationOptions& options, int threads,
                                 StageClock* clock) {
  const LabelContext context{
      views, structure, FindAliases(structure), segmenter, initial, options, threads, clock};
  std::vector<OrientationTrial> trials;
  if (AsksNetwork(initial.method, segmenter != nullptr))
    trials = pose_internal::TryOrientations(context);
  std::vector<std::vector<OrientationTrial*>> by_view(views.size());
  for (OrientationTrial& trial : trials) by_view[trial.view].push_back(&trial);
  std::vector<std::vector<PoseCandidate>> competitors(views.size());
  ParallelFor(views.size(), threads,
              [&](std::size_t i) { competitors[i] = Competitors(context, i, by_view[i]); });
  const std::vector<PoseChoice> choices = ChooseAll(context, by_view, competitors);
  std::vector<Labelled> labelled(views.size());
  ParallelFor(views.size(), threads,
              [&](std::size_t i) { labelled[i] = TakePose(context, i, by_view[i], choices[i]); });
  clock->Lap("initial_pose");
  return labelled;
}

Labelled UpdateInitialPose(const SensorView& view, Labelled labelled, const Structure& structure,
                           const InitialPoseOptions& initial) {
  if (!labelled.initial.found) return labelled;
  const Pose near = labelled.initial.structure_from_sensor;
  if (!labelled.ByNetwork()) {
    LabelledPose again = LabelByPose(view, structure, near, initial);
    if (again.initial.found) {
      labelled.segmentation = std::move(again.segmentation);
      labelled.initial = std::move(again.initial);
    }
    return labelled;
  }
  InitialPose updated = EstimateInitialPose(view, labelled.segmentation, structure, initial, &near);
  if (updated.found) labelled.initial = std::move(updated);
  return labelled;
}

}  // namespace volalign
