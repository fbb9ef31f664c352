#include "infer/initial/orientation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <utility>

#include "core/base/odds.h"
#include "core/base/parallel_for.h"
#include "infer/depth/explain_view.h"
#include "infer/initial/floor.h"
#include "infer/initial/rig_choice.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

namespace {

using Labellings = std::vector<const Labelling*>;

/// The constants of one call of LabelViews.
struct LabelContext {
  const std::vector<LabelRequest>& views;
  const Structure& structure;
  const std::vector<StructureSymmetry> symmetries;
  Segmenter* segmenter;
  PoseMethod method;
  int threads;
  StageClock* clock;
};

bool IsSettled(const LabelContext& context, const SensorView& view, const Labelling& labelling) {
  if (!labelling.initial.found) return false;
  const Pose& pose = labelling.initial.structure_from_sensor;
  const int stride = StrideForRays(view.depth.size(), kCoarseRays);
  const SegmentationResult labels = Decimate(labelling.segmentation, stride);
  const ViewExplanation by_view =
      ExplainView(Decimate(view, stride), &labels, context.structure, pose, kRoughPose);
  const double decisive = std::log(kDecisiveOdds);
  return by_view.LogOddsByDepth() + by_view.LogOddsByLabels() >= decisive &&
         FloorMargin(view, context.structure, context.symmetries, pose) >= decisive;
}

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
    labelling.initial = EstimateInitialPose(view, labelling.segmentation, context.structure);
    labelling.settled = IsSettled(context, view, labelling);
  });
  context.clock->Lap("initial_pose");
  return labellings;
}

/// All labellings that are needed to know every view's orientation; see LabelViews.
std::vector<Labelling> TryOrientations(const LabelContext& context) {
  std::vector<Labelling> all;
  std::set<std::size_t> open;  // views whose turns are to be found
  const auto add = [&](const Orientations& wanted) {
    for (Labelling& labelling : Try(context, wanted)) {
      if (labelling.settled) open.erase(labelling.view);
      all.push_back(std::move(labelling));
    }
  };
  Orientations own;
  for (std::size_t i = 0; i < context.views.size(); ++i) {
    const LabelRequest& from = context.views[i];
    if (!from.usable) continue;
    own.emplace_back(i, from.quarter_turns == kAutoTurns ? 0 : from.quarter_turns);
    if (from.quarter_turns == kAutoTurns) open.insert(i);
  }
  add(own);
  if (open.empty()) return all;
  const std::size_t probe = *open.begin();
  add({{probe, 1}, {probe, 2}, {probe, 3}});
  open.erase(probe);
  int usual = 1;  // turns of the rig's sensors, as the probe tells
  for (const Labelling& labelling : all)
    if (labelling.view == probe && labelling.settled) usual = labelling.turns;
  for (int k = 0; k < 3; ++k) {
    Orientations wanted;
    for (const std::size_t i : open) wanted.emplace_back(i, 1 + (usual - 1 + k) % 3);
    add(wanted);
  }
  return all;
}

/// A pose with the labels that it implies, in place of a network's. It is verified as one that
/// geometry has found. If no network tells the turns, they are the frame's own, or put the floor at
/// the bottom.
void TakeImplied(const LabelContext& context, const LabelRequest& from, const Hypothesis& chosen,
                 Labelled* out) {
  const Pose& pose = chosen.structure_from_sensor;
  static_cast<LabelledPose&>(*out) = LabelByPose(*from.view, context.structure, pose);
  out->source = PoseSource::kGeometry;
  const int found = chosen.source == PoseSource::kNetwork ? chosen.turns : UprightTurns(pose);
  out->quarter_turns = from.quarter_turns == kAutoTurns ? found : from.quarter_turns;
}

/// A labelling's labels and pose.
void TakeLabelling(const Labelling& labelling, Labelled* out) {
  static_cast<LabelledPose&>(*out) = labelling;
  out->quarter_turns = labelling.turns;
}

/// The hypotheses about a view's pose, by the network and by geometry. If labels and depths settle
/// one orientation alone, there is only its pose, and geometry is not asked.
SensorHypotheses HypothesesOf(const LabelContext& context, const LabelRequest& from,
                              const Labellings& labellings) {
  SensorHypotheses sensor{from.view, {}, from.chosen, from.prior};
  if (!from.usable) return sensor;
  const bool known_up = from.quarter_turns != kAutoTurns;
  const auto settled = [](const Labelling* labelling) { return labelling->settled; };
  const auto only = std::find_if(labellings.begin(), labellings.end(), settled);
  if (std::count_if(labellings.begin(), labellings.end(), settled) == 1) {
    sensor.poses = {{(*only)->initial.structure_from_sensor, PoseSource::kNetwork,
                     static_cast<std::size_t>(only - labellings.begin()), -1,
                     known_up ? 0 : (*only)->turns}};
  } else {
    sensor.poses = FindHypotheses(*from.view, context.structure, context.symmetries, labellings,
                                  known_up, context.method);
  }
  return sensor;
}

/// A view's chosen pose, with the labels that suit it. Without any pose, there are the labels of
/// the first orientation.
Labelled TakePose(const LabelContext& context, const LabelRequest& from,
                  const Labellings& labellings, const PoseChoice& choice) {
  Labelled out;
  out.alternatives = choice.alternatives;
  out.given = choice.given;
  const Hypothesis& best = choice.best;
  if (choice.ambiguous()) {
    const Pose& other = choice.alternatives.front().structure_from_sensor;
    out.other_pose = DescribeMotion(best.structure_from_sensor, other);
    out.floor_would_tell = LeavesFloor(best.structure_from_sensor, other);
  }
  const bool is_own =
      choice.found && best.source == PoseSource::kNetwork &&
      SamePose(context.structure, labellings[best.labelling]->initial.structure_from_sensor,
               best.structure_from_sensor);
  if (is_own) {
    TakeLabelling(*labellings[best.labelling], &out);
  } else if (choice.found) {
    TakeImplied(context, from, best, &out);
  } else if (labellings.empty()) {
    out.segmentation = {LabelImage(from.view->width(), from.view->height()),
                        Image<float>(from.view->width(), from.view->height())};
    out.source = PoseSource::kGeometry;
  } else {
    TakeLabelling(*labellings.front(), &out);
  }
  return out;
}

}  // namespace

std::vector<Labelled> LabelViews(const std::vector<LabelRequest>& views, const Structure& structure,
                                 Segmenter* segmenter, const InitialPoseOptions& initial,
                                 int threads, StageClock* clock) {
  const LabelContext context{
      views, structure, FindSymmetries(structure), segmenter, initial.method, threads, clock};
  std::vector<Labelling> all;
  if (segmenter && initial.method != PoseMethod::kGeometry) all = TryOrientations(context);
  std::vector<Labellings> labellings(views.size());
  for (const Labelling& labelling : all) labellings[labelling.view].push_back(&labelling);
  std::vector<SensorHypotheses> sensors(views.size());
  ParallelFor(views.size(), threads,
              [&](std::size_t i) { sensors[i] = HypothesesOf(context, views[i], labellings[i]); });
  const std::vector<PoseChoice> choices = ChooseTogether(sensors, structure);
  std::vector<Labelled> labelled(views.size());
  ParallelFor(views.size(), threads, [&](std::size_t i) {
    labelled[i] = TakePose(context, views[i], labellings[i], choices[i]);
  });
  clock->Lap("initial_pose");
  return labelled;
}

}  // namespace volalign
