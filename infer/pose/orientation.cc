#include "infer/pose/orientation.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <tuple>
#include <utility>

#include "core/parallel_for.h"
#include "infer/pose/aliases.h"
#include "infer/pose/floor.h"
#include "infer/pose/relabel.h"
#include "infer/pose/rig_choice.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

namespace {

/// What does not change while views are labelled.
struct Context {
  const std::vector<UnlabelledView>& views;
  const Structure& structure;
  const std::vector<StructureAlias> aliases;
  Segmenter& segmenter;
  const InitialPoseOptions& initial;
  const OrientationOptions& options;
  int threads;
  StageClock* clock;
};

/// A view in one orientation: what the network sees in it, and the pose that follows.
struct Trial {
  std::size_t view = 0;
  int turns = 0;
  SegmentationResult segmentation;
  InitialPose initial;
  double floor_margin = 0;  // FloorMargin at the pose

  double score() const { return initial.found ? initial.agreement.score() : 0; }
};

/// Beyond doubt: the labels fit the structure, and it stands on a floor. Upside down, or shifted by
/// a box, it would not.
bool Decided(const Trial& trial, const OrientationOptions& options) {
  return trial.initial.found && trial.floor_margin >= options.choice.floor_margin &&
         trial.score() >= options.decided_score;
}

bool Settled(const Trial& trial, const OrientationOptions& options) {
  return Decided(trial, options) && trial.score() >= options.good_score;
}

/// Views in orientations, as (index, turns).
using Orientations = std::vector<std::pair<std::size_t, int>>;

/// Segments and poses each, in as few forward passes as sizes allow.
std::vector<Trial> Try(const Context& context, const Orientations& wanted) {
  if (wanted.empty()) return {};
  std::vector<SegmentationRequest> requests;
  for (const auto& [view, turns] : wanted) {
    const UnlabelledView& from = context.views[view];
    requests.push_back({&from.view->depth, from.intrinsics, turns});
  }
  std::vector<SegmentationResult> segmentations = context.segmenter.Segment(requests);
  context.clock->Lap("segmentation");
  std::vector<Trial> trials(wanted.size());
  ParallelFor(wanted.size(), context.threads, [&](std::size_t t) {
    Trial& trial = trials[t];
    trial.view = wanted[t].first;
    trial.turns = wanted[t].second;
    trial.segmentation = std::move(segmentations[t]);
    const SensorView& view = *context.views[trial.view].view;
    trial.initial =
        EstimateInitialPose(view, trial.segmentation, context.structure, context.initial);
    if (trial.initial.found) {
      trial.floor_margin = FloorMargin(view, context.structure, context.aliases,
                                       trial.initial.structure_from_sensor);
    }
  });
  context.clock->Lap("initial_pose");
  return trials;
}

/// Views among the trials whose turns are to be found and that the trial does not decide.
std::vector<std::size_t> Undecided(const Context& context, const std::vector<Trial>& trials) {
  std::vector<std::size_t> open;
  for (const Trial& trial : trials) {
    if (context.views[trial.view].quarter_turns == kAutoTurns && !Decided(trial, context.options))
      open.push_back(trial.view);
  }
  return open;
}

/// All trials that are needed to know every view's orientation; see LabelViews.
std::vector<Trial> TryOrientations(const Context& context) {
  Orientations own;
  for (std::size_t i = 0; i < context.views.size(); ++i) {
    const int turns = context.views[i].quarter_turns;
    if (context.views[i].usable) own.emplace_back(i, turns == kAutoTurns ? 0 : turns);
  }
  std::vector<Trial> all = Try(context, own);
  const auto append = [&](std::vector<Trial> trials) {
    std::move(trials.begin(), trials.end(), std::back_inserter(all));
  };

  std::vector<std::size_t> open = Undecided(context, all);
  if (open.empty()) return all;
  Orientations others;
  for (int turns = 1; turns < 4; ++turns) others.emplace_back(open.front(), turns);
  std::vector<Trial> probe = Try(context, others);
  int usual = 0;  // turns of the rig's sensors, as the probe tells
  for (const Trial& trial : probe) {
    if (Decided(trial, context.options)) usual = trial.turns;
  }
  append(std::move(probe));
  open.erase(open.begin());

  if (usual != 0) {
    Orientations as_usual;
    for (const std::size_t i : open) as_usual.emplace_back(i, usual);
    std::vector<Trial> trials = Try(context, as_usual);
    open = Undecided(context, trials);
    append(std::move(trials));
  }
  Orientations rest;
  for (const std::size_t i : open) {
    for (int turns = 1; turns < 4; ++turns) {
      if (turns != usual) rest.emplace_back(i, turns);
    }
  }
  append(Try(context, rest));
  return all;
}

/// The trial whose pose fits and stands on the floor best.
Trial* BestTrial(const std::vector<Trial*>& trials, const OrientationOptions& options) {
  double best_score = 0;
  for (const Trial* t : trials) best_score = std::max(best_score, t->score());
  const auto rank = [&](const Trial* t) {
    const bool rival = t->score() >= options.choice.rival_score * best_score;
    return std::make_tuple(Settled(*t, options), rival, t->floor_margin, t->score());
  };
  return *std::max_element(trials.begin(), trials.end(),
                           [&](const Trial* a, const Trial* b) { return rank(a) < rank(b); });
}

/// Turns that bring the view into the network's orientation at a pose that a trial led to.
int TurnsAt(const Context& context, const Trial& trial, const PoseEvidence& pose) {
  const bool over =
      pose.alias >= 0 && !context.aliases[static_cast<std::size_t>(pose.alias)].keeps_up();
  return (trial.turns + (over ? 2 : 0)) % 4;
}

/// The labels that suit a pose which was chosen among orientations and aliases, and the initial
/// pose that follows from them.
void TakeChoice(const Context& context, const UnlabelledView& from, const PoseEvidence& choice,
                const std::vector<Trial*>& trials, const Trial& trial, LabelledView* out) {
  if (choice.alias >= 0) {
    const StructureAlias& alias = context.aliases[static_cast<std::size_t>(choice.alias)];
    out->quarter_turns = TurnsAt(context, trial, choice);
    out->segmentation = Relabelled(std::move(out->segmentation), alias);
  }
  const Pose& pose = choice.structure_from_sensor;
  if (choice.label_score < context.options.good_score) {
    std::vector<const SegmentationResult*> others;
    for (const Trial* other : trials) {
      if (other != &trial) others.push_back(&other->segmentation);
    }
    ReconcileLabels(*from.view, context.structure, context.aliases, pose, others,
                    context.initial.evidence.min_confidence, &out->segmentation);
  }
  out->initial =
      EstimateInitialPose(*from.view, out->segmentation, context.structure, context.initial, &pose);
}

/// The poses that compete for a view over all orientations and aliases: the only one where a single
/// orientation is beyond doubt. The paper's estimator knows none.
std::vector<PoseEvidence> Competitors(const Context& context, std::size_t i,
                                      const std::vector<Trial*>& trials) {
  const UnlabelledView& from = context.views[i];
  const OrientationOptions& options = context.options;
  if (trials.empty() || context.initial.method != PoseMethod::kRobust) return {};
  const auto settled = [&](const Trial* t) { return Settled(*t, options); };
  if (std::count_if(trials.begin(), trials.end(), settled) == 1) {
    const auto only = std::find_if(trials.begin(), trials.end(), settled);
    PoseEvidence pose;
    pose.structure_from_sensor = (*only)->initial.structure_from_sensor;
    pose.trial = static_cast<std::size_t>(only - trials.begin());
    return {pose};
  }
  std::vector<PoseTrial> poses;
  poses.reserve(trials.size());
  for (const Trial* t : trials) poses.push_back({&t->segmentation, &t->initial});
  return FindCompetitors(*from.view, context.structure, context.aliases, poses,
                         from.quarter_turns != kAutoTurns, context.initial, options.choice);
}

/// Chooses for each view alone and, where that leaves one ambiguous or two that are mounted in
/// different ways, for all of them together.
std::vector<PoseChoice> ChooseAll(const Context& context,
                                  const std::vector<std::vector<Trial*>>& trials,
                                  const std::vector<std::vector<PoseEvidence>>& competitors) {
  std::vector<PoseChoice> choices(competitors.size());
  std::vector<SensorCandidates> sensors(competitors.size());
  std::set<int> mounted;
  bool ambiguous = false, open = false;
  for (std::size_t i = 0; i < competitors.size(); ++i) {
    choices[i] = Decide(competitors[i], context.options.choice);
    sensors[i] = {context.views[i].view, competitors[i], {}};
    for (const PoseEvidence& pose : competitors[i]) {
      if (context.views[i].quarter_turns == kAutoTurns)
        sensors[i].turns.push_back(TurnsAt(context, *trials[i][pose.trial], pose));
    }
    if (!choices[i].found) continue;
    ambiguous = ambiguous || choices[i].ambiguous;
    open = open || competitors[i].size() > 1;
    mounted.insert(UprightTurns(choices[i].best.structure_from_sensor));
  }
  if (!ambiguous && !(open && mounted.size() > 1)) return choices;
  return ChooseTogether(sensors, context.structure, context.options.choice);
}

/// A view's chosen pose, with the labels that suit it. Without a choice that can be trusted, the
/// orientation that fits and stands on the floor best.
LabelledView TakePose(const Context& context, std::size_t i, const std::vector<Trial*>& trials,
                      const PoseChoice& choice) {
  const UnlabelledView& from = context.views[i];
  const OrientationOptions& options = context.options;
  LabelledView out;
  if (trials.empty()) {
    out.segmentation = {LabelImage(from.view->width(), from.view->height()),
                        Image<float>(from.view->width(), from.view->height())};
    return out;
  }
  const bool trusted = choice.found && choice.best.overlap >= options.min_shape_overlap &&
                       choice.best.label_score >= options.min_label_score;
  const Trial& trial = trusted ? *trials[choice.best.trial] : *BestTrial(trials, options);
  out.quarter_turns = trial.turns;
  out.segmentation = trial.segmentation;
  out.initial = trial.initial;
  if (choice.ambiguous) {
    out.other_pose =
        DescribeMotion(choice.best.structure_from_sensor, choice.rival.structure_from_sensor);
  }
  out.up_unknown = choice.up_unknown;
  if (trusted) TakeChoice(context, from, choice.best, trials, trial, &out);
  return out;
}

}  // namespace

std::vector<LabelledView> LabelViews(const std::vector<UnlabelledView>& views,
                                     const Structure& structure, Segmenter& segmenter,
                                     const InitialPoseOptions& initial,
                                     const OrientationOptions& options, int threads,
                                     StageClock* clock) {
  const Context context{views,   structure, FindAliases(structure), segmenter, initial, options,
                        threads, clock};
  std::vector<Trial> trials = TryOrientations(context);
  std::vector<std::vector<Trial*>> by_view(views.size());
  for (Trial& trial : trials) by_view[trial.view].push_back(&trial);
  std::vector<std::vector<PoseEvidence>> competitors(views.size());
  ParallelFor(views.size(), threads,
              [&](std::size_t i) { competitors[i] = Competitors(context, i, by_view[i]); });
  const std::vector<PoseChoice> choices = ChooseAll(context, by_view, competitors);
  std::vector<LabelledView> labelled(views.size());
  ParallelFor(views.size(), threads,
              [&](std::size_t i) { labelled[i] = TakePose(context, i, by_view[i], choices[i]); });
  clock->Lap("initial_pose");
  return labelled;
}

void UpdateInitialPoses(const std::vector<SensorView>& views, const Structure& structure,
                        const InitialPoseOptions& initial, int threads,
                        std::vector<LabelledView>* labelled) {
  ParallelFor(views.size(), threads, [&](std::size_t i) {
    LabelledView& of = (*labelled)[i];
    if (!of.initial.found) return;
    const Pose near = of.initial.structure_from_sensor;
    InitialPose updated = EstimateInitialPose(views[i], of.segmentation, structure, initial, &near);
    if (updated.found) of.initial = std::move(updated);
  });
}

}  // namespace volalign
