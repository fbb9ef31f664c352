#include "infer/calib/calibrate.h"

#include <algorithm>
#include <optional>
#include <thread>
#include <utility>

#include "core/base/stage_clock.h"
#include "infer/calib/check_request.h"
#include "infer/calib/hypotheses.h"
#include "infer/calib/joint_solution.h"
#include "infer/calib/judge.h"
#include "infer/calib/look.h"
#include "infer/checks/assembly.h"
#include "infer/checks/lens_check.h"
#include "infer/lens/find_lenses.h"

namespace volalign {

namespace {

/// `stack`: how the stack stands, as far as known.
CalibrationResult CalibrateAs(const CaptureSet& input, const StackFinding& stack,
                              Segmenter* segmenter, const CalibrateOptions& options,
                              const CalibrateProgress& progress, StageClock* clock) {
  const auto begin = [&](const char* stage) {
    if (progress) progress(stage);
  };
  const int threads = options.threads;
  begin("lenses, by walls and floors");
  const bool estimated = ParseEstimate(options.refine.estimate).lens;
  const LensSet assumed =
      estimated ? AssumeLenses(input, options.refine.lens_per_sensor) : GivenLenses(input);
  FoundLenses found = FindLenses(input, assumed, threads);
  clock->Lap("lenses");

  begin("first poses");
  Seen seen = Look(input, std::move(found), segmenter, options, clock);

  Joint joint = SolveJointly(std::move(seen), stack, options, progress, clock);

  begin("residuals and verdict");
  const PerFrame<std::optional<Finding>> suspect_lenses = CheckLenses(
      FindPlanes(joint.seen.views, joint.seen.lenses, threads), joint.seen.lenses, estimated);
  clock->Lap("lenses");
  CalibrationResult result = Judge(std::move(joint), stack, suspect_lenses, options);
  clock->Lap("metrics");
  return result;
}

/// The finding of InspectAssembly in a capture whose sensors fail or contradict each other. Nothing
/// if the stack stands as described.
std::optional<AssemblyReport> InspectCapture(const StackResult& capture, const Structure& structure,
                                             const CalibrateOptions& options) {
  if (std::none_of(capture.sensors.begin(), capture.sensors.end(), [&](const FrameResult& sensor) {
        return QuestionsStack(sensor, capture.alternatives);
      })) {
    return std::nullopt;
  }
  std::vector<const SensorView*> views;
  for (const FrameResult& sensor : capture.sensors) {
    const bool shows = sensor.structure_from_sensor || FailedToFindStack(sensor.code);
    views.push_back(shows ? &sensor.view : nullptr);
  }
  AssemblyReport report = InspectAssembly(views, structure, options.threads);
  if (!report.altered() && report.mirrored_frames.empty()) return std::nullopt;
  return report;
}

StackFinding InspectStack(const CalibrationResult& result, const Structure& structure,
                          const CalibrateOptions& options) {
  if (result.captures.empty()) return {InspectCapture(result, structure, options)};
  StackFinding stack;
  for (const CaptureResult& capture : result.captures)
    stack.push_back(InspectCapture(capture, structure, options));
  return stack;
}

}  // namespace

CalibrationResult Calibrate(const std::vector<Capture>& captures, const Structure& structure,
                            Segmenter* segmenter, const CalibrateOptions& asked_for,
                            const CalibrateProgress& progress) {
  StageClock clock;
  CalibrateOptions options = asked_for;
  // Ceres warns of more threads than there are processors.
  options.refine.threads =
      std::min(options.threads, static_cast<int>(std::thread::hardware_concurrency()));
  const CaptureSet input = CheckRequest(captures, structure, options, segmenter != nullptr);
  CalibrationResult result =
      CalibrateAs(input, StackFinding(captures.size()), segmenter, options, progress, &clock);
  if (options.assembly.enabled) {
    const StackFinding stack = InspectStack(result, structure, options);
    clock.Lap("assembly");
    if (std::any_of(stack.begin(), stack.end(), [](const auto& of) { return of.has_value(); }))
      result = CalibrateAs(input, stack, segmenter, options, progress, &clock);
  }
  if (!result.assembly || !result.assembly->altered()) {
    CalibrateOptions of_others = options;  // other frames may have other alternatives
    of_others.orientation.choose.clear();
    TryHypotheses(
        captures.front(), structure, options,
        [&](const Capture& other) {
          StageClock unused;
          return CalibrateAs(CheckRequest({other}, structure, of_others, segmenter != nullptr),
                             StackFinding(1), segmenter, of_others, {}, &unused);
        },
        &result);
  }
  clock.Lap("hypotheses");
  result.timings_s = clock.Total();
  return result;
}

CalibrationResult Calibrate(const std::vector<Capture>& captures, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  return Calibrate(captures, structure, &segmenter, options);
}

CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options) {
  return Calibrate(std::vector<Capture>{{"", frames}}, structure, &segmenter, options);
}

}  // namespace volalign
