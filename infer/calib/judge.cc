#include "infer/calib/judge.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <variant>

#include "core/base/lists.h"
#include "core/base/parallel_for.h"
#include "infer/calib/combine_captures.h"
#include "infer/checks/free_space.h"
#include "infer/checks/pose_quality.h"
#include "infer/checks/rig_findings.h"

namespace volalign {

namespace {

void SetFinding(SensorStatus status, const Finding& finding, FrameResult* sensor) {
  sensor->status = status;
  static_cast<Finding&>(*sensor) = finding;
}

void TakeRefinement(const RefinedFrame& refined, const Pose& initial, FrameResult* sensor) {
  sensor->initial = initial;
  if (refined.refused_fit && refined.refused_fit->disagrees)
    sensor->together = refined.refused_fit->structure_from_sensor;
  sensor->disagreement = refined.disagreement;
  sensor->structure_from_sensor = refined.structure_from_sensor;
  sensor->covariance = refined.covariance;
  sensor->depth_offset_m = refined.depth_offset;
  sensor->depth_gain = refined.depth_gain;
  sensor->sigma_depth_offset_m = refined.sigma_depth_offset;
  sensor->sigma_depth_gain = refined.sigma_depth_gain;
}

void TakeLens(const Joint& joint, FrameId id, FrameResult* sensor) {
  const LensSet& lenses = joint.seen.lenses;
  sensor->lens = {lenses.Of(id).source, lenses.Of(id).prior_sigmas};
  if (joint.refined.lenses.empty()) return;
  const RefinedLens& refined = joint.refined.lenses[lenses.of_frame[id]];
  if (refined.estimated) sensor->lens.source = LensSource::kEstimated;
  sensor->lens.sigmas = refined.sigmas;
}

Finding TypicalIntrinsics(const std::string& kind) {
  return {SensorCode::kTypicalIntrinsics,
          fmt::format("its intrinsics are typical of {}, not its own: principal points of one kind "
                      "differ by several pixels, and each pixel turns the pose",
                      kind),
          "read the intrinsics from the device or from a recording of it, and give them in the "
          "capture"};
}

/// The last moves as a text; empty if the frame has settled.
std::string WhatMoves(const SolveReport& report, const FrameSolution& frame) {
  if (frame.settled) return "";
  return fmt::format("round {} still moved the sensor by {:.1f} mm{}", report.rounds,
                     1000 * frame.moved_m,
                     report.converged ? "" : ". It ended because all its steps were used");
}

/// Residuals, errors and status of a located frame at its reported pose.
void JudgeFrame(const Joint& joint, FrameId id, const std::optional<Finding>& suspect_lens,
                const std::optional<FreeSpaceViolation>& free_space_violation,
                const CalibrateOptions& options, FrameResult* sensor) {
  const SensorFrame& frame = (*joint.seen.input)[id];
  const auto& located = std::get<LocatedFrame>(joint.located[id]);
  const Labelled& labelled = joint.seen.labelled[id];
  const RefinedFrame& refined = joint.frames.at(id).refined;
  const Structure& built = joint.refined.placements[id.capture].built;
  const Pose& pose = *sensor->structure_from_sensor;
  static_cast<PoseQuality&>(*sensor) = MeasureQuality(
      Corrected(sensor->view, sensor->depth_gain, sensor->depth_offset_m), sensor->segmentation,
      labelled.initial.patches, refined.refused_fit ? refined.refused_fit->built : built, pose);
  sensor->initial_rms_to_structure_m = FitToSurface(sensor->view, sensor->segmentation.labels,
                                                    joint.seen.input->structure, sensor->initial)
                                           .rms_to_structure_m;
  if (frame.ground_truth) {
    sensor->error = ComparePoses(pose, *frame.ground_truth);
    sensor->initial_error = ComparePoses(sensor->initial, *frame.ground_truth);
  }
  std::optional<ContradictedSensors> contradiction;
  if (sensor->together)
    contradiction = {sensor->disagrees_with, ComparePoses(*sensor->together, pose)};
  const std::optional<Finding> weakness = FindWeakness(
      {*sensor, pose, sensor->covariance, refined.problem, contradiction,
       joint.seen.depths[id].same_depth_as, suspect_lens, labelled.other_pose,
       labelled.alternatives.empty() ? 0 : labelled.alternatives.front().log_odds,
       labelled.floor_would_tell, free_space_violation, frame.quarter_turns != kAutoTurns,
       located.shape_log_odds, WhatMoves(joint.report, joint.frames.at(id))},
      options.verdict);
  sensor->status = SensorStatus::kOk;
  if (weakness) {
    SetFinding(SensorStatus::kWeak, *weakness, sensor);
  } else if (frame.typical_intrinsics) {
    SetFinding(SensorStatus::kWeak, TypicalIntrinsics(frame.sensor), sensor);
  }
  DemoteIfNotFinite(sensor);
}

void JudgeDuplicates(std::vector<FrameResult>* sensors) {
  std::vector<std::string> names;
  std::vector<std::optional<Pose>> poses;
  for (const FrameResult& sensor : *sensors) {
    names.push_back(sensor.name);
    poses.push_back(sensor.structure_from_sensor);
  }
  const std::vector<std::optional<Finding>> duplicates = FindDuplicates(names, poses);
  for (std::size_t i = 0; i < duplicates.size(); ++i) {
    if (duplicates[i]) SetFinding(SensorStatus::kWeak, *duplicates[i], &(*sensors)[i]);
  }
}

std::optional<SetDistances> MeasureSetDistances(const std::vector<FrameResult>& sensors,
                                                const Structure& built, int threads) {
  std::vector<std::vector<Eigen::Vector3d>> of_sensor(sensors.size());
  ParallelFor(sensors.size(), threads, [&](std::size_t i) {
    const FrameResult& sensor = sensors[i];
    if (!sensor.structure_from_sensor) return;
    of_sensor[i] = LabelledPoints(Corrected(sensor.view, sensor.depth_gain, sensor.depth_offset_m),
                                  sensor.segmentation.labels, *sensor.structure_from_sensor);
  });
  std::vector<Eigen::Vector3d> captured;
  for (const std::vector<Eigen::Vector3d>& points : of_sensor)
    captured.insert(captured.end(), points.begin(), points.end());
  return CompareWithSurface(captured, built, threads);
}

/// The result of FindFreeSpaceViolations for each frame of a capture. A frame whose pose a person
/// has chosen takes part, but has no result.
std::vector<std::optional<FreeSpaceViolation>> RefutedInCapture(const Joint& joint,
                                                                std::size_t capture,
                                                                const CalibrateOptions& options) {
  const std::size_t count = joint.located.OfCapture(capture).size();
  std::vector<const SensorView*> views(count, nullptr);
  std::vector<Pose> poses(count, Pose::Identity());
  for (std::size_t i = 0; i < count; ++i) {
    const auto solution = joint.frames.find({capture, i});
    if (solution == joint.frames.end()) continue;
    views[i] = &joint.seen.views[{capture, i}];
    poses[i] = solution->second.refined.structure_from_sensor;
  }
  std::vector<std::optional<FreeSpaceViolation>> found = FindFreeSpaceViolations(
      views, poses, joint.refined.placements[capture].built, kDecisiveOdds, options.threads);
  for (std::size_t i = 0; i < count; ++i) {
    if (found[i]) found[i]->name = (*joint.seen.input)[{capture, found[i]->other}].name;
    if (joint.seen.labelled[{capture, i}].given) found[i].reset();
  }
  return found;
}

/// The result of a frame without the verdict on a located one. Takes its images.
FrameResult ResultOf(FrameId id, Joint* joint) {
  const Seen& seen = joint->seen;
  Labelled& labelled = joint->seen.labelled[id];
  FrameResult sensor;
  sensor.name = (*seen.input)[id].name;
  sensor.intrinsics = seen.lenses.Effective(id);
  sensor.intrinsics_given = (*seen.input)[id].intrinsics;
  TakeLens(*joint, id, &sensor);
  sensor.view = std::move(joint->seen.views[id]);
  sensor.segmentation = std::move(labelled.segmentation);
  sensor.quarter_turns = labelled.quarter_turns;
  if (const auto* failure = std::get_if<Finding>(&joint->located[id])) {
    SetFinding(SensorStatus::kFailed, *failure, &sensor);
    if (labelled.initial.found) sensor.best_guess = labelled.initial.structure_from_sensor;
    return sensor;
  }
  const FrameSolution& solution = joint->frames.at(id);
  TakeRefinement(solution.refined, labelled.initial.structure_from_sensor, &sensor);
  sensor.initial_source = labelled.source;
  if (const auto placed = joint->priors.find(id); placed != joint->priors.end()) {
    sensor.prior = joint->refined.placements[id.capture].first_from_placement.inverse() *
                   placed->second.prior.world_from_sensor;
    sensor.prior_used = placed->second.used;
  }
  for (const FrameId other : solution.contradicts)
    sensor.disagrees_with.push_back((*seen.input)[other].name);
  return sensor;
}

/// The sets of poses that the capture's sensors may have instead. Those that kNamedOdds rule out
/// are absent.
std::vector<RigAlternative> AlternativesOf(const Joint& joint, std::size_t capture,
                                           const std::vector<FrameResult>& sensors) {
  std::map<int, RigAlternative> alternatives;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    if (!sensors[i].structure_from_sensor) continue;
    for (const PoseAlternative& alternative : joint.seen.labelled[{capture, i}].alternatives) {
      if (alternative.log_odds > std::log(kNamedOdds)) continue;
      RigAlternative& rig = alternatives[alternative.rig];
      rig.log_odds = alternative.log_odds;
      rig.sensors.push_back(
          {sensors[i].name, alternative.number, alternative.structure_from_sensor});
    }
  }
  std::vector<RigAlternative> list;
  for (auto& [rig, alternative] : alternatives) list.push_back(std::move(alternative));
  std::stable_sort(list.begin(), list.end(), [](const RigAlternative& a, const RigAlternative& b) {
    return a.log_odds < b.log_odds;
  });
  return list;
}

/// Does the sensor have a pose that nothing speaks against?
bool IsBelieved(const FrameResult& sensor) {
  const auto doubted = {SensorCode::kDuplicateDepth, SensorCode::kIntrinsicsSuspect,
                        SensorCode::kDisagrees,      SensorCode::kAmbiguous,
                        SensorCode::kUnsolved,       SensorCode::kSamePose};
  return sensor.structure_from_sensor &&
         std::find(doubted.begin(), doubted.end(), sensor.code) == doubted.end();
}

/// If most others do not find the stack, a sensor may see something else.
void DoubtThoseAlone(std::vector<FrameResult>* sensors) {
  const auto lost = std::count_if(sensors->begin(), sensors->end(), [](const FrameResult& each) {
    return each.code == SensorCode::kNoStructure || each.code == SensorCode::kInconsistent;
  });
  const auto others = static_cast<std::ptrdiff_t>(sensors->size()) - 1;
  if (2 * lost <= others) return;
  for (FrameResult& sensor : *sensors) {
    if (!IsBelieved(sensor)) continue;
    SetFinding(SensorStatus::kWeak,
               {SensorCode::kAmbiguous,
                fmt::format("{} of {} other sensors did not find the stack. This sensor may see "
                            "something else, or the boxes do not stand as described",
                            lost, others),
                "compare the boxes with the structure file first: their order, their directions "
                "and their sizes"},
               &sensor);
  }
}

/// Names of the boxes with findings.
std::string BoxesThatAreOff(const std::vector<RigFinding>& findings) {
  std::vector<std::string> names;
  for (const RigFinding& finding : findings) {
    if (finding.code == RigCode::kBoxOff)
      AddIfNew(finding.about.front(), &names,
               [&](const std::string& name) { return name == finding.about.front(); });
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

/// The report on a stack without an altered arrangement.
AssemblyReport ReportDescribed(const std::vector<FrameResult>& sensors, const Structure& structure,
                               const std::vector<RigFinding>& findings) {
  AssemblyReport report;
  report.arrangement.structure = structure;
  double points = 0;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    if (!IsBelieved(sensors[i])) continue;
    report.seen_by.push_back(i);
    report.share += sensors[i].points * sensors[i].explained_share;
    points += sensors[i].points;
  }
  report.share /= std::max(1.0, points);
  report.described_share = report.share;
  const std::string off = BoxesThatAreOff(findings);
  const std::string described =
      "the boxes stand as described" + (off.empty() ? "" : " but for " + off);
  report.arrangement.sentence = 2 * report.seen_by.size() > sensors.size()
                                    ? described
                                    : fmt::format("not known whether {}: {} of {} sensors show it",
                                                  described, report.seen_by.size(), sensors.size());
  return report;
}

/// The result of a capture from its frames' results.
CaptureResult GatherCapture(std::size_t capture, std::vector<FrameResult> sensors,
                            std::optional<AssemblyReport> assembly, const CalibrateOptions& options,
                            Joint* joint) {
  RefinedPlacement& stack = joint->refined.placements[capture];
  JudgeDuplicates(&sensors);
  DoubtThoseAlone(&sensors);
  if (options.assembly.enabled && !(assembly && assembly->altered())) {
    AssemblyReport described =
        ReportDescribed(sensors, joint->seen.input->structure, joint->findings);
    if (assembly) described.mirrored_frames = std::move(assembly->mirrored_frames);
    assembly = std::move(described);
  }
  CaptureResult result;
  result.name = joint->seen.input->captures[capture].name;
  result.first_from_placement = stack.first_from_placement;
  result.covariance = stack.covariance;
  result.metrics = MeasureSetDistances(sensors, stack.built, options.threads);
  result.pairs = std::move(joint->pairs[capture]);
  result.alternatives = AlternativesOf(*joint, capture, sensors);
  result.sensors = std::move(sensors);
  result.assembly = std::move(assembly);
  result.built = std::move(stack.built);
  result.boxes = std::move(stack.boxes);
  return result;
}

}  // namespace

bool FailedToFindStack(SensorCode code) {
  return code == SensorCode::kNoStructure || code == SensorCode::kInconsistent ||
         code == SensorCode::kDegenerateSides;
}

bool QuestionsStack(const SensorOutcome& sensor, const std::vector<RigAlternative>& alternatives) {
  const auto has_sensor = [&](const RigAlternative& alternative) {
    return std::any_of(alternative.sensors.begin(), alternative.sensors.end(),
                       [&](const SensorAlternative& each) { return each.name == sensor.name; });
  };
  const SensorCode code = sensor.code;
  return FailedToFindStack(code) || code == SensorCode::kDisagrees ||
         code == SensorCode::kFewInliers || code == SensorCode::kLargeResidual ||
         code == SensorCode::kLabelsDisagree ||
         (code == SensorCode::kAmbiguous &&
          std::none_of(alternatives.begin(), alternatives.end(), has_sensor));
}

CalibrationResult Judge(Joint joint, const StackFinding& stack,
                        const PerFrame<std::optional<Finding>>& suspect_lenses,
                        const CalibrateOptions& options) {
  std::vector<std::vector<std::optional<FreeSpaceViolation>>> refuted;
  for (std::size_t capture = 0; capture < joint.located.captures(); ++capture)
    refuted.push_back(RefutedInCapture(joint, capture, options));
  PerFrame<FrameResult> sensors =
      MapFrames(joint.located, options.threads, [&](FrameId id) { return ResultOf(id, &joint); });
  std::vector<FrameId> solved;
  for (const auto& [id, solution] : joint.frames) solved.push_back(id);
  ParallelFor(solved.size(), options.threads, [&](std::size_t k) {
    const FrameId id = solved[k];
    JudgeFrame(joint, id, suspect_lenses[id], refuted[id.capture][id.frame], options, &sensors[id]);
  });
  std::vector<std::pair<const SensorView*, Pose>> placed;
  for (const FrameResult& sensor : sensors.OfCapture(0)) {
    if (IsBelieved(sensor)) placed.emplace_back(&sensor.view, *sensor.structure_from_sensor);
  }
  for (RigFinding& finding : FindCoveredSides(placed, joint.seen.input->structure))
    joint.findings.push_back(std::move(finding));
  std::vector<CaptureResult> captures;
  for (std::size_t s = 0; s < sensors.captures(); ++s) {
    captures.push_back(
        GatherCapture(s, std::move(sensors.OfCapture(s)), stack[s], options, &joint));
  }
  CalibrationResult result = CombineCaptures(*joint.seen.input, std::move(captures), joint.frames);
  static_cast<RefinedSize&>(result) = joint.refined;
  result.findings = std::move(joint.findings);
  result.solve = joint.report;
  return result;
}

}  // namespace volalign
