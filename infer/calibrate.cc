#include "infer/calibrate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/stage_clock.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/neighbours.h"
#include "infer/checks/placement.h"
#include "infer/judge.h"

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
                            RefineOptions options) {
  options.coarse = std::any_of(sensors.begin(), sensors.end(),
                               [](const RefineSensor& s) { return !s.use_structure_terms; });
  return Refine(structure, sensors, options);
}

}  // namespace

CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  CheckRequest(frames, options);
  StageClock clock;
  std::vector<SensorView> views = MakeSensorViews(frames, options.threads);
  std::vector<DepthFinding> depths = CheckDepths(frames, views, options.verdict);
  clock.Lap("rays");
  std::vector<LabelledView> labelled =
      LabelViews(Unlabelled(frames, views, depths), structure, segmenter, options.initial,
                 options.orientation, options.threads, &clock);
  const PlacementOptions placement{options.initial, options.refine, options.verdict,
                                   options.assembly, options.threads};
  std::optional<AssemblyReport> assembly = InspectStack(views, labelled, structure, placement);
  clock.Lap("assembly");
  std::vector<Placement> placements =
      PlaceSensors(frames, views, depths, labelled, assembly, structure, placement);
  placements =
      PlaceByNeighbours(frames, views, labelled, std::move(placements), structure, placement);
  clock.Lap("placement");
  RefineResult refined = RefineTogether(
      structure, SensorsToRefine(frames, labelled, placements, options.refine), options.refine);
  clock.Lap("refinement");
  CalibrationResult result =
      JudgeSensors(frames, structure,
                   {std::move(depths), std::move(views), std::move(labelled), std::move(placements),
                    std::move(assembly), std::move(refined)},
                   {options.verdict, options.initial.evidence.min_confidence, options.threads});
  clock.Lap("metrics");
  result.timings_s = clock.Total();
  return result;
}

}  // namespace volalign
