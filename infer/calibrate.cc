#include "infer/calibrate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/stage_clock.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/lens_check.h"
#include "infer/checks/neighbours.h"
#include "infer/checks/placement.h"
#include "infer/judge.h"
#include "infer/refine/find_lenses.h"

namespace volalign {

namespace {

/// Throws ConfigError or DataError for what no stage could make sense of.
void CheckRequest(const std::vector<SensorFrame>& frames, const CalibrateOptions& options) {
  ValidateConfig(options);
  ParseEstimate(options.refine.estimate);
  std::vector<std::string> names;
  for (const SensorFrame& frame : frames) {
    if (std::count(names.begin(), names.end(), frame.name) > 0) {
      throw DataError(
          fmt::format("two sensors are named \"{}\"; names must be unique", frame.name));
    }
    names.push_back(frame.name);
  }
  for (const std::string& name : options.refine.without_structure) {
    if (std::count(names.begin(), names.end(), name) > 0) continue;
    throw ConfigError(fmt::format(
        "refine.without_structure names \"{}\", which is no sensor of the capture", name));
  }
}

/// Requests for LabelViews; frames whose depths failed get no labels.
std::vector<UnlabelledView> Unlabelled(const std::vector<SensorFrame>& frames,
                                       const std::vector<SensorView>& views,
                                       const std::vector<DepthFinding>& depths) {
  std::vector<UnlabelledView> unlabelled;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    unlabelled.push_back(
        {&views[i], &frames[i].intrinsics, frames[i].quarter_turns, !depths[i].failure});
  }
  return unlabelled;
}

/// Only sensors without structure terms, which have not been refined alone, need the coarse stage.
RefineResult RefineTogether(const Structure& structure, const std::vector<RefineSensor>& sensors,
                            const LensSet& lenses, RefineOptions options) {
  options.coarse = std::any_of(sensors.begin(), sensors.end(),
                               [](const RefineSensor& s) { return !s.use_structure_terms; });
  return Refine(structure, sensors, options, lenses.lenses);
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

CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  CheckRequest(frames, options);
  const bool estimate_lens = ParseEstimate(options.refine.estimate).lens;
  const int threads = options.threads;
  StageClock clock;
  LensSet lenses = FindLenses(
      frames,
      estimate_lens ? AssumeLenses(frames, options.refine.lens_per_sensor) : GivenLenses(frames),
      threads);
  clock.Lap("lenses");
  std::vector<SensorFrame> seen = SeenThrough(frames, lenses);
  std::vector<SensorView> views = MakeSensorViews(seen, threads);
  std::vector<DepthFinding> depths = CheckDepths(seen, views, options.verdict);
  clock.Lap("rays");
  std::vector<LabelledView> labelled =
      LabelViews(Unlabelled(seen, views, depths), structure, segmenter, options.initial,
                 options.orientation, threads, &clock);
  const PlacementOptions placement{options.initial, options.refine, options.verdict,
                                   options.assembly, threads};
  std::optional<AssemblyReport> assembly = InspectStack(views, labelled, structure, placement);
  clock.Lap("assembly");
  std::vector<Placement> placements;
  RefineResult refined;
  for (int round = 1;; ++round) {
    placements = PlaceByNeighbours(
        seen, views, labelled,
        PlaceSensors(seen, views, depths, labelled, assembly, lenses, structure, placement), lenses,
        structure, placement);
    clock.Lap("placement");
    refined = RefineTogether(structure,
                             SensorsToRefine(seen, labelled, placements, lenses, options.refine),
                             lenses, options.refine);
    clock.Lap("refinement");
    const double moved = TakeLenses(refined, &lenses);
    if (moved > 0) {
      seen = SeenThrough(frames, lenses);
      views = MakeSensorViews(seen, threads);
    }
    if (moved < kLinearPx || round == kMostLensRounds) break;
    MeasureLenses(FindPlanes(views, lenses, threads), threads, &lenses);
    UpdateInitialPoses(views, structure, options.initial, threads, &labelled);
  }
  std::vector<std::optional<Finding>> suspect_lenses =
      CheckLenses(FindPlanes(views, lenses, threads), lenses, estimate_lens, options.verdict.lens);
  clock.Lap("lenses");
  CalibrationResult result = JudgeSensors(
      frames, structure,
      {std::move(depths), std::move(views), std::move(labelled), std::move(placements),
       std::move(assembly), std::move(refined), std::move(lenses), std::move(suspect_lenses)},
      {options.verdict, options.initial.evidence.min_confidence, threads});
  clock.Lap("metrics");
  result.timings_s = clock.Total();
  return result;
}

}  // namespace volalign
