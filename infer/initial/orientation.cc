#include "infer/initial/orientation.h"

#include <algorithm>
#include <utility>

#include "core/base/parallel_for.h"
#include "infer/initial/labellings.h"
#include "infer/initial/rig_choice.h"
#include "infer/initial/symmetries.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

namespace {

using pose_internal::BestLabelling;
using pose_internal::LabelContext;
using pose_internal::Settled;
using Labellings = std::vector<const Labelling*>;

/// A pose with the labels that it implies, in place of a network's. It is verified as one that
/// geometry has found. If no network tells the turns, they are the frame's own, or put the floor at
/// the bottom.
void TakeImplied(const LabelContext& context, const LabelRequest& from, const Hypothesis& chosen,
                 Labelled* out) {
  const Pose& pose = chosen.structure_from_sensor;
  LabelledPose labelled = LabelByPose(*from.view, context.structure, pose, context.initial);
  out->segmentation = std::move(labelled.segmentation);
  out->initial = std::move(labelled.initial);
  out->source = PoseSource::kGeometry;
  const int found = chosen.source == PoseSource::kNetwork ? chosen.turns : UprightTurns(pose);
  out->quarter_turns = from.quarter_turns == kAutoTurns ? found : from.quarter_turns;
}

/// A labelling's labels and pose.
void TakeLabelling(const Labelling& labelling, Labelled* out) {
  out->quarter_turns = labelling.turns;
  out->segmentation = labelling.segmentation;
  out->initial = labelling.initial;
}

/// The hypotheses about a view's pose, by the network and by geometry. If labels and depths settle
/// one orientation alone, there is only its pose, and geometry is not asked.
SensorHypotheses HypothesesOf(const LabelContext& context, const LabelRequest& from,
                              const Labellings& labellings) {
  SensorHypotheses sensor{from.view, {}, from.chosen, from.prior};
  if (!from.usable || context.initial.method == PoseMethod::kPaper) return sensor;
  const auto settled = [](const Labelling* labelling) { return Settled(*labelling); };
  if (std::count_if(labellings.begin(), labellings.end(), settled) == 1) {
    const auto only = std::find_if(labellings.begin(), labellings.end(), settled);
    sensor.poses = {{(*only)->initial.structure_from_sensor, PoseSource::kNetwork,
                     static_cast<std::size_t>(only - labellings.begin()), -1,
                     from.quarter_turns == kAutoTurns ? (*only)->turns : 0}};
  } else {
    sensor.poses = FindHypotheses(*from.view, context.structure, context.symmetries, labellings,
                                  from.quarter_turns != kAutoTurns, context.initial);
  }
  return sensor;
}

/// A view's chosen pose, with the labels that suit it. Without a choice that can be trusted, it is
/// the pose of the orientation that fits and stands on the floor best.
Labelled TakePose(const LabelContext& context, const LabelRequest& from,
                  const Labellings& labellings, const PoseChoice& choice) {
  Labelled out;
  out.up_unknown = choice.up_unknown;
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
    TakeLabelling(*BestLabelling(labellings), &out);
  }
  return out;
}

}  // namespace

std::vector<Labelled> LabelViews(const std::vector<LabelRequest>& views, const Structure& structure,
                                 Segmenter* segmenter, const InitialPoseOptions& initial,
                                 int threads, StageClock* clock) {
  const LabelContext context{views,   structure, FindSymmetries(structure), segmenter, initial,
                             threads, clock};
  std::vector<Labelling> all;
  if (segmenter && initial.method != PoseMethod::kGeometry)
    all = pose_internal::TryOrientations(context);
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
