#include "infer/calib/calibrate.h"

#include <optional>
#include <utility>

#include "core/base/stage_clock.h"
#include "infer/calib/check_request.h"
#include "infer/calib/hypotheses.h"
#include "infer/calib/joint_solution.h"
#include "infer/calib/judge.h"
#include "infer/calib/look.h"
#include "infer/checks/lens_check.h"
#include "infer/lens/find_lenses.h"

namespace volalign {

namespace {

CalibrationResult CalibrateAsGiven(const std::vector<Still>& stills, const Structure& structure,
                                   Segmenter* segmenter, const CalibrateOptions& options,
                                   const CalibrateProgress& progress) {
  const auto begin = [&](const char* stage) {
    if (progress) progress(stage);
  };
  const int threads = options.threads;
  StageClock clock;
  const CaptureSet capture = CheckRequest(stills, structure, options, segmenter != nullptr);

  begin("lenses, by walls and floors");
  const bool estimated = ParseEstimate(options.refine.estimate).lens;
  const LensSet assumed =
      estimated ? AssumeLenses(capture, options.refine.lens_per_sensor) : GivenLenses(capture);
  FoundLenses found = FindLenses(capture, assumed, threads);
  clock.Lap("lenses");

  begin("first poses");
  Seen seen = Look(capture, std::move(found), segmenter, options, &clock);
  const StackFinding stack = InspectStack(
      seen, options.assembly, {options.initial, options.refine, options.verdict, threads});
  clock.Lap("assembly");

  Joint joint = SolveJointly(std::move(seen), stack, segmenter, options, progress, &clock);

  begin("residuals and verdict");
  const PerFrame<std::optional<Finding>> suspect_lenses =
      CheckLenses(FindPlanes(joint.seen.views, joint.seen.lenses, threads), joint.seen.lenses,
                  estimated, options.verdict.lens);
  clock.Lap("lenses");
  CalibrationResult result = Judge(std::move(joint), stack, suspect_lenses, options);
  clock.Lap("metrics");
  result.timings_s = clock.Total();
  return result;
}

}  // namespace

CalibrationResult Calibrate(const std::vector<Still>& stills, const Structure& structure,
                            Segmenter* segmenter, const CalibrateOptions& options,
                            const CalibrateProgress& progress) {
  CalibrationResult result = CalibrateAsGiven(stills, structure, segmenter, options, progress);
  TryHypotheses(
      stills, structure, options,
      [&](const std::vector<Still>& other) {
        return CalibrateAsGiven(other, structure, segmenter, options, {});
      },
      &result);
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
