#include "infer/calibrate.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "core/stage_clock.h"
#include "infer/check_request.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/join.h"
#include "infer/checks/lens_check.h"
#include "infer/checks/neighbours.h"
#include "infer/checks/placement.h"
#include "infer/combine_stills.h"
#include "infer/joint_solution.h"
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

/// Places the sensors in every still.
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
    joint = SolveJointly(structure, stages, lenses, stood, placement);
    if (DropWithoutShape(joint.refined, placement, &stages)) {
      stood = Join(&stages);
      joint = SolveJointly(structure, stages, lenses, stood, placement);
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
