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
std::vector<Labelling> Try(const LabelContext& context, const Orientations& wanted) {
  if (wanted.empty()) return {};
  std::vector<SegmentationRequest> requests;
  for (const auto& [view, turns] : wanted) {
    const LabelRequest& from = context.views[view];
    requests.push_back({&from.view->depth, from.intrinsics, turns});
  }
  std::vector<SegmentationResult> segmentations = context.segmenter->Segment(requests);
  context.clock->Lap("segmentation");
  std::vector<Labelling> labellings(wanted.size());
  ParallelFor(wanted.size(), context.threads, [&](std::size_t t) {
    Labelling& labelling = labellings[t];
    labelling.view = wanted[t].first;
    labelling.turns = wanted[t].second;
    labelling.segmentation = std::move(segmentations[t]);
    const SensorView& view = *context.views[labelling.view].view;
    labelling.initial =
        EstimateInitialPose(view, labelling.segmentation, context.structure, context.initial);
    if (!labelling.initial.found) return;
    const Pose& pose = labelling.initial.structure_from_sensor;
    const int stride = StrideForRays(view.depth.size(), kCoarseRays);
    const SegmentationResult labels = Decimate(labelling.segmentation, stride);
    const ViewExplanation explanation = ExplainView(
        Decimate(view, stride), &labels, context.structure, pose, kRoughPose, kLeastConfidence);
    labelling.by_view = explanation.LogOddsByDepth() + explanation.LogOddsByLabels();
    labelling.by_floor = FloorMargin(view, context.structure, context.symmetries, pose);
  });
  context.clock->Lap("initial_pose");
  return labellings;
}

/// Views among the labellings whose turns are to be found and that the labelling does not settle.
std::vector<std::size_t> Open(const LabelContext& context,
                              const std::vector<Labelling>& labellings) {
  std::vector<std::size_t> open;
  for (const Labelling& labelling : labellings) {
    if (context.views[labelling.view].quarter_turns == kAutoTurns && !Settled(labelling))
      open.push_back(labelling.view);
  }
  return open;
}

}  // namespace

bool Settled(const Labelling& labelling) {
  const double decisive = std::log(kDecisiveOdds);
  return labelling.initial.found && labelling.by_view >= decisive && labelling.by_floor >= decisive;
}

std::vector<Labelling> TryOrientations(const LabelContext& context) {
  Orientations own;
  for (std::size_t i = 0; i < context.views.size(); ++i) {
    const int turns = context.views[i].quarter_turns;
    if (context.views[i].usable) own.emplace_back(i, turns == kAutoTurns ? 0 : turns);
  }
  std::vector<Labelling> all = Try(context, own);
  const auto append = [&](std::vector<Labelling> labellings) {
    std::move(labellings.begin(), labellings.end(), std::back_inserter(all));
  };

  std::vector<std::size_t> open = Open(context, all);
  if (open.empty()) return all;
  Orientations others;
  for (int turns = 1; turns < 4; ++turns) others.emplace_back(open.front(), turns);
  std::vector<Labelling> probe = Try(context, others);
  int usual = 0;  // turns of the rig's sensors, as the probe tells
  for (const Labelling& labelling : probe) {
    if (Settled(labelling)) usual = labelling.turns;
  }
  append(std::move(probe));
  open.erase(open.begin());

  if (usual != 0) {
    Orientations as_usual;
    for (const std::size_t i : open) as_usual.emplace_back(i, usual);
    std::vector<Labelling> labellings = Try(context, as_usual);
    open = Open(context, labellings);
    append(std::move(labellings));
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

const Labelling* BestLabelling(const std::vector<const Labelling*>& labellings) {
  const auto rank = [](const Labelling* t) {
    return std::make_tuple(Settled(*t), t->initial.found, t->by_view + t->by_floor);
  };
  return *std::max_element(
      labellings.begin(), labellings.end(),
      [&](const Labelling* a, const Labelling* b) { return rank(a) < rank(b); });
}

}  // namespace volalign::pose_internal
