#include "infer/calibrate.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <variant>

#include "core/parallel_for.h"
#include "core/pose.h"
#include "core/stage_clock.h"
#include "infer/check_request.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/join.h"
#include "infer/checks/lens_check.h"
#include "infer/checks/neighbours.h"
#include "infer/checks/placement.h"
#include "infer/checks/verification.h"
#include "infer/combine_stills.h"
#include "infer/pose/shape_check.h"
#include "infer/refine/find_lenses.h"
#include "infer/stills.h"

namespace volalign {

namespace {

/// The request for LabelViews; frames whose depths failed get no labels.
std::vector<UnlabelledView> Unlabelled(const StillStages& still) {
  std::vector<UnlabelledView> unlabelled;
  for (std::size_t i = 0; i < still.seen.size(); ++i) {
    unlabelled.push_back({&still.views[i], &still.seen[i].intrinsics, still.seen[i].quarter_turns,
                          !still.depths[i].failure});
  }
  return unlabelled;
}

/// Labels follow the joint solution, so often at most, and while a sensor moves farther than this,
/// m.
constexpr int kLabelRounds = 6;
constexpr double kLabelsStay = 0.002;

/// Only sensors without structure terms, which have not been refined alone, need the coarse stage.
RefineResult RefineTogether(const Structure& structure, const std::vector<RefineFrame>& frames,
                            const LensSet& lenses, const std::vector<Pose>& placements,
                            RefineOptions options) {
  options.coarse = std::any_of(frames.begin(), frames.end(),
                               [](const RefineFrame& f) { return !f.use_structure_terms; });
  return Refine(structure, frames, options, lenses.lenses, placements);
}

/// The joint solution, and what it was found from.
struct JointSolution {
  std::vector<RefineFrame> frames;
  std::vector<SensorPoints> points;  ///< of the frames
  RefineResult refined;
};

/// The seen views of all placed sensors, in the order of FramesToRefine.
std::vector<SeenView> PlacedViews(const std::vector<StillStages>& stages, const LensSet& lenses) {
  std::vector<SeenView> views;
  for (const StillStages& still : stages) {
    for (std::size_t i = 0; i < still.seen.size(); ++i) {
      if (std::holds_alternative<PlacedSensor>(still.placements[i]))
        views.push_back({still.views[i], still.seen[i].intrinsics, lenses.Of(still.first + i)});
    }
  }
  return views;
}

/// Solves for all sensors together, with the labels that the solution itself implies: the stack as
/// it is found, seen from the poses that are found, labels the points anew, and everything is
/// solved again from there, until the poses stay. What the first labels came from, a network or
/// geometry, then makes little difference.
JointSolution RefineWithItsLabels(const Structure& structure,
                                  const std::vector<StillStages>& stages, const LensSet& lenses,
                                  const std::vector<Pose>& stood, const PlacementOptions& options) {
  JointSolution joint;
  joint.frames = FramesToRefine(stages, lenses, options.refine);
  joint.refined = RefineTogether(structure, joint.frames, lenses, stood, options.refine);
  const std::vector<SeenView> views = PlacedViews(stages, lenses);
  joint.points.resize(views.size());
  for (int round = 0; round < kLabelRounds; ++round) {
    RefineOptions again = options.refine;
    std::vector<std::size_t> with_sides;
    double moved = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const RefinedFrame& found = joint.refined.frames[i];
      if (!joint.frames[i].use_structure_terms || !found.accepted) continue;
      with_sides.push_back(i);
      moved = std::max(
          moved, ComparePoses(joint.frames[i].start, found.structure_from_sensor).translation_m);
    }
    if (moved < kLabelsStay) break;
    // Points are associated anew in each round. A sensor that was refused begins where it did.
    if (with_sides.size() == views.size()) again.fine_iterations = 1;
    ParallelFor(with_sides.size(), options.threads, [&](std::size_t k) {
      const std::size_t i = with_sides[k];
      RefineFrame& frame = joint.frames[i];
      frame.start = joint.refined.frames[i].structure_from_sensor;
      const auto still = static_cast<std::size_t>(frame.still);
      joint.points[i] =
          PlaceAt(views[i], joint.refined.placements[still].built, frame.start, options).points;
      frame.points = &joint.points[i];
    });
    joint.refined = RefineTogether(structure, joint.frames, lenses, stood, again);
  }
  return joint;
}

void PlaceInStills(const Structure& structure, const LensSet& all_lenses,
                   const PlacementOptions& options, std::vector<StillStages>* stages) {
  for (StillStages& still : *stages) {
    const LensSet lenses = still.Lenses(all_lenses);
    still.placements =
        PlaceByNeighbours(still.seen, still.views, still.labelled,
                          PlaceSensors(still.seen, still.views, still.depths, still.labelled,
                                       still.assembly, lenses, structure, options),
                          lenses, structure, options);
  }
}

/// Where the stack stood in each still.
std::vector<Pose> Join(std::vector<StillStages>* stages) {
  std::vector<PlacedStill> placed;
  for (StillStages& still : *stages)
    placed.push_back({still.still->name, still.seen, still.labelled, &still.placements});
  return JoinStills(placed);
}

/// A sensor that geometry alone has placed, and that the joint solution takes to where its view
/// does not have the structure's shape, is placed no longer. Returns whether there is one.
bool DropWithoutShape(const RefineResult& refined, const PlacementOptions& options,
                      std::vector<StillStages>* stages) {
  bool dropped = false;
  std::size_t frame = 0;
  for (std::size_t still = 0; still < stages->size(); ++still) {
    StillStages& stage = (*stages)[still];
    for (std::size_t i = 0; i < stage.placements.size(); ++i) {
      const auto* placed = std::get_if<PlacedSensor>(&stage.placements[i]);
      if (!placed) continue;
      const Pose& pose = refined.frames[frame++].structure_from_sensor;
      if (!placed->visible_by_geometry ||
          VisibleWithShape(stage.views[i], refined.placements[still].built, pose,
                           options.initial)) {
        continue;
      }
      stage.placements[i] = ExplainMissingShape();
      dropped = true;
    }
  }
  return dropped;
}

/// The lenses as the refinement found them. Returns how far, px, a picture moved.
double TakeLenses(const RefineResult& refined, LensSet* lenses) {
  const LensSet before = *lenses;
  for (std::size_t i = 0; i < lenses->lenses.size(); ++i)
    lenses->lenses[i].change = refined.lenses[i].change;
  double moved = 0;
  for (std::size_t i = 0; i < lenses->assumed.size(); ++i)
    moved = std::max(moved, LargestShift(before.Effective(i), lenses->Effective(i)));
  return moved;
}

/// The refinement is linear in the lenses: a picture that has moved farther, px, is looked at
/// again, so many times at most.
constexpr double kLinearPx = 2;
constexpr int kMostLensRounds = 3;

}  // namespace

CalibrationResult Calibrate(const std::vector<Still>& stills, const Structure& structure,
                            Segmenter* segmenter, const CalibrateOptions& options,
                            const CalibrateProgress& progress) {
  const auto begin = [&](const char* stage) {
    if (progress) progress(stage);
  };
  begin("lenses, by walls and floors");
  CheckRequest(stills, options, segmenter != nullptr);
  const bool estimate_lens = ParseEstimate(options.refine.estimate).lens;
  const int threads = options.threads;
  StageClock clock;
  const std::vector<SensorFrame> frames = AllFrames(stills);
  LensSet lenses = FindLenses(
      frames,
      estimate_lens ? AssumeLenses(frames, options.refine.lens_per_sensor) : GivenLenses(frames),
      threads);
  clock.Lap("lenses");
  std::vector<StillStages> stages = BeginStages(stills);
  SeeThrough(lenses, threads, &stages);
  for (StillStages& still : stages)
    still.depths = CheckDepths(still.seen, still.views, options.verdict);
  clock.Lap("rays");
  const PlacementOptions placement{options.initial, options.refine, options.verdict,
                                   options.assembly, threads};
  begin("first poses");
  for (StillStages& still : stages) {
    still.labelled = LabelViews(Unlabelled(still), structure, segmenter, options.initial,
                                options.orientation, threads, &clock);
    still.assembly = InspectStack(still.views, still.labelled, structure, placement);
    clock.Lap("assembly");
  }
  JointSolution joint;
  for (int round = 1;; ++round) {
    begin("each sensor by itself");
    PlaceInStills(structure, lenses, placement, &stages);
    std::vector<Pose> stood = Join(&stages);
    clock.Lap("placement");
    begin("all sensors together");
    joint = RefineWithItsLabels(structure, stages, lenses, stood, placement);
    if (DropWithoutShape(joint.refined, placement, &stages)) {
      stood = Join(&stages);
      joint = RefineWithItsLabels(structure, stages, lenses, stood, placement);
    }
    clock.Lap("refinement");
    const double moved = TakeLenses(joint.refined, &lenses);
    if (moved > 0) SeeThrough(lenses, threads, &stages);
    if (moved < kLinearPx || round == kMostLensRounds) break;
    MeasureLenses(FindPlanes(stages, lenses, threads), threads, &lenses);
    for (StillStages& still : stages)
      UpdateInitialPoses(still.views, structure, options.initial, threads, &still.labelled);
  }
  begin("residuals and verdict");
  const std::vector<std::optional<Finding>> suspect_lenses =
      CheckLenses(FindPlanes(stages, lenses, threads), lenses, estimate_lens, options.verdict.lens);
  clock.Lap("lenses");
  CalibrationResult result = CombineStills(
      stills,
      JudgeStills(std::move(stages), structure, joint.refined, lenses, suspect_lenses,
                  {options.verdict, options.initial.evidence.min_confidence, threads}),
      joint.frames, joint.refined);
  clock.Lap("metrics");
  result.timings_s = clock.Total();
  return result;
}

CalibrationResult Calibrate(const std::vector<Still>& stills, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  return Calibrate(stills, structure, &segmenter, options);
}

CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  return Calibrate(std::vector<Still>{{"", frames}}, structure, &segmenter, options);
}

}  // namespace volalign
