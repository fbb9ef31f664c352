#include "infer/initial/orientation_trials.h"

#include <algorithm>
#include <iterator>
#include <tuple>
#include <utility>

#include "core/base/parallel_for.h"
#include "infer/initial/floor.h"
#include "infer/view/sensor_frame.h"

namespace volalign::pose_internal {

namespace {

/// Views in orientations, as (index, turns).
using Orientations = std::vector<std::pair<std::size_t, int>>;

/// Segments and poses each, in as few forward passes as sizes allow.
std::vector<OrientationTrial> Try(const LabelContext& context, const Orientations& wanted) {
  if (wanted.empty()) return {};
  std::vector<SegmentationRequest> requests;
  for (const auto& [view, turns] : wanted) {
    const LabelRequest& from = context.views[view];
    requests.push_back({&from.view->depth, from.intrinsics, turns});
  }
  std::vector<SegmentationResult> segmentations = context.segmenter->Segment(requests);
  context.clock->Lap("segmentation");
  std::vector<OrientationTrial> trials(wanted.size());
  ParallelFor(wanted.size(), context.threads, [&](std::size_t t) {
    OrientationTrial& trial = trials[t];
    trial.view = wanted[t].first;
    trial.turns = wanted[t].second;
    trial.segmentation = std::move(segmentations[t]);
    const SensorView& view = *context.views[trial.view].view;
    trial.initial =
        EstimateInitialPose(view, trial.segmentation, context.structure, context.initial);
    if (trial.initial.found) {
      trial.floor_margin =
          FloorMargin(view, context.structure, context.aliases, trial.initial.structure_from_sensor,
                      context.initial.table_height_m);
    }
  });
  context.clock->Lap("initial_pose");
  return trials;
}

/// Views among the trials whose turns are to be found and that the trial does not decide.
std::vector<std::size_t> Undecided(const LabelContext& context,
                                   const std::vector<OrientationTrial>& trials) {
  std::vector<std::size_t> open;
  for (const OrientationTrial& trial : trials) {
    if (context.views[trial.view].quarter_turns == kAutoTurns && !Decided(trial, context.options))
      open.push_back(trial.view);
  }
  return open;
}

}  // namespace

bool Decided(const OrientationTrial& trial, const OrientationOptions& options) {
  return trial.initial.found && trial.floor_margin >= options.choice.floor_margin &&
         trial.score() >= options.decided_score;
}

bool Settled(const OrientationTrial& trial, const OrientationOptions& options) {
  return Decided(trial, options) && trial.score() >= options.good_score;
}

std::vector<OrientationTrial> TryOrientations(const LabelContext& context) {
  Orientations own;
  for (std::size_t i = 0; i < context.views.size(); ++i) {
    const int turns = context.views[i].quarter_turns;
    if (context.views[i].usable) own.emplace_back(i, turns == kAutoTurns ? 0 : turns);
  }
  std::vector<OrientationTrial> all = Try(context, own);
  const auto append = [&](std::vector<OrientationTrial> trials) {
    std::move(trials.begin(), trials.end(), std::back_inserter(all));
  };

  std::vector<std::size_t> open = Undecided(context, all);
  if (open.empty()) return all;
  Orientations others;
  for (int turns = 1; turns < 4; ++turns) others.emplace_back(open.front(), turns);
  std::vector<OrientationTrial> probe = Try(context, others);
  int usual = 0;  // turns of the rig's sensors, as the probe tells
  for (const OrientationTrial& trial : probe) {
    if (Decided(trial, context.options)) usual = trial.turns;
  }
  append(std::move(probe));
  open.erase(open.begin());

  if (usual != 0) {
    Orientations as_usual;
    for (const std::size_t i : open) as_usual.emplace_back(i, usual);
    std::vector<OrientationTrial> trials = Try(context, as_usual);
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

OrientationTrial* BestTrial(const std::vector<OrientationTrial*>& trials,
                            const OrientationOptions& options) {
  double best_score = 0;
  for (const OrientationTrial* t : trials) best_score = std::max(best_score, t->score());
  const auto rank = [&](const OrientationTrial* t) {
    const bool rival = t->score() >= options.choice.rival_score * best_score;
    return std::make_tuple(Settled(*t, options), rival, t->floor_margin, t->score());
  };
  return *std::max_element(
      trials.begin(), trials.end(),
      [&](const OrientationTrial* a, const OrientationTrial* b) { return rank(a) < rank(b); });
}

}  // namespace volalign::pose_internal
