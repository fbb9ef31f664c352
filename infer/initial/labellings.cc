#include "infer/initial/labellings.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <tuple>
#include <utility>

#include "core/base/odds.h"
#include "core/base/parallel_for.h"
#include "infer/depth/explain_view.h"
#include "infer/initial/floor.h"
#include "infer/view/alike.h"
#include "infer/view/sensor_frame.h"

namespace volalign::pose_internal {

namespace {

/// Views in orientations, as (index, turns).
using Orientations = std::vector<std::pair<std::size_t, int>>;

/// Segments each view and finds its pose, in as few forward passes as sizes allow.
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
    if (!trial.initial.found) return;
    const Pose& pose = trial.initial.structure_from_sensor;
    const int stride = StrideForRays(view.depth.size(), kCoarseRays);
    const SegmentationResult labels = Decimate(trial.segmentation, stride);
    const ViewExplanation explanation = ExplainView(
        Decimate(view, stride), &labels, context.structure, pose, kRoughPose, kLeastConfidence);
    trial.by_view = explanation.LogOddsByDepth() + explanation.LogOddsByLabels();
    trial.by_floor = FloorMargin(view, context.structure, context.symmetries, pose);
  });
  context.clock->Lap("initial_pose");
  return trials;
}

/// Views among the trials whose turns are to be found and that the trial does not settle.
std::vector<std::size_t> Open(const LabelContext& context,
                              const std::vector<OrientationTrial>& trials) {
  std::vector<std::size_t> open;
  for (const OrientationTrial& trial : trials) {
    if (context.views[trial.view].quarter_turns == kAutoTurns && !Settled(trial))
      open.push_back(trial.view);
  }
  return open;
}

}  // namespace

bool Settled(const OrientationTrial& trial) {
  const double decisive = std::log(kDecisiveOdds);
  return trial.initial.found && trial.by_view >= decisive && trial.by_floor >= decisive;
}

std::vector<OrientationTrial> TryOrientations(const LabelContext& context) {
  Orientations own;
  for (std::size_t i = 0; i < context.views.size(); ++i) {
    const int turns = context.views[i].quarter_turns;
    if (context.views[i].usable && !context.views[i].known)
      own.emplace_back(i, turns == kAutoTurns ? 0 : turns);
  }
  std::vector<OrientationTrial> all = Try(context, own);
  const auto append = [&](std::vector<OrientationTrial> trials) {
    std::move(trials.begin(), trials.end(), std::back_inserter(all));
  };

  std::vector<std::size_t> open = Open(context, all);
  if (open.empty()) return all;
  Orientations others;
  for (int turns = 1; turns < 4; ++turns) others.emplace_back(open.front(), turns);
  std::vector<OrientationTrial> probe = Try(context, others);
  int usual = 0;  // turns of the rig's sensors, as the probe tells
  for (const OrientationTrial& trial : probe) {
    if (Settled(trial)) usual = trial.turns;
  }
  append(std::move(probe));
  open.erase(open.begin());

  if (usual != 0) {
    Orientations as_usual;
    for (const std::size_t i : open) as_usual.emplace_back(i, usual);
    std::vector<OrientationTrial> trials = Try(context, as_usual);
    open = Open(context, trials);
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

const OrientationTrial* BestTrial(const std::vector<const OrientationTrial*>& trials) {
  const auto rank = [](const OrientationTrial* t) {
    return std::make_tuple(Settled(*t), t->initial.found, t->by_view + t->by_floor);
  };
  return *std::max_element(
      trials.begin(), trials.end(),
      [&](const OrientationTrial* a, const OrientationTrial* b) { return rank(a) < rank(b); });
}

}  // namespace volalign::pose_internal
