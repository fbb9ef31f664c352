#include "infer/judge.h"

#include <cstddef>
#include <string>
#include <utility>
#include <variant>

#include "core/parallel_for.h"
#include "infer/checks/pose_quality.h"
#include "infer/checks/verdict.h"

namespace volalign {

namespace {

void SetFinding(SensorStatus status, const Finding& finding, SensorResult* sensor) {
  sensor->status = status;
  sensor->code = finding.code;
  sensor->reason = finding.reason;
  sensor->hint = finding.hint;
}

void TakeRefinement(const RefinedFrame& refined, const Pose& initial, SensorResult* sensor) {
  sensor->initial = initial;
  sensor->refinement_accepted = refined.accepted;
  if (refined.refused_fit) sensor->together = refined.refused_fit->structure_from_sensor;
  sensor->disagreement = refined.disagreement;
  sensor->rms_together_m = refined.rms_together;
  sensor->rms_alone_m = refined.rms_alone;
  sensor->structure_from_sensor = refined.structure_from_sensor;
  sensor->covariance = refined.covariance;
  sensor->depth_offset_m = refined.depth_offset;
  sensor->depth_gain = refined.depth_gain;
  sensor->sigma_depth_offset_m = refined.sigma_depth_offset;
  sensor->sigma_depth_gain = refined.sigma_depth_gain;
}

/// What the initial pose came from.
PoseSource SourceOf(const PlacedSensor& placed, const LabelledView& labelled) {
  return placed.by_neighbours ? PoseSource::kNeighbours : labelled.source;
}

void TakeLens(const LensSet& lenses, const RefineResult& refined, std::size_t frame,
              SensorResult* sensor) {
  const auto lens = static_cast<std::size_t>(lenses.of_frame[frame]);
  sensor->lens = {lenses.lenses[lens].source, lenses.lenses[lens].prior_sigmas};
  if (lens >= refined.lenses.size()) return;
  if (refined.lenses[lens].estimated) sensor->lens.source = LensSource::kEstimated;
  sensor->lens.sigmas = refined.lenses[lens].sigmas;
}

/// Residuals, errors and status of a placed sensor at its reported pose.
void Judge(const SensorFrame& frame, const PlacedSensor& placed, const DepthFinding& depth,
           const LabelledView& labelled, const std::optional<Finding>& suspect_lens,
           const RefinedFrame& refined, const Structure& nominal, const Structure& built,
           const JudgeOptions& options, SensorResult* sensor) {
  const Pose& pose = *sensor->structure_from_sensor;
  const PoseQuality quality = MeasureQuality(
      Corrected(sensor->view, sensor->depth_gain, sensor->depth_offset_m), sensor->segmentation,
      labelled.initial.evidence, refined.refused_fit ? refined.refused_fit->built : built, pose,
      options.min_confidence);
  sensor->points = quality.surface.points;
  sensor->rms_to_structure_m = quality.surface.rms_m;
  sensor->inlier_share = quality.surface.inlier_share;
  sensor->miou = quality.miou;
  sensor->label_iou = quality.label_iou;
  sensor->explained_share = quality.explained_share;
  sensor->sides = quality.sides;
  sensor->initial_rms_to_structure_m =
      FitToSurface(sensor->view, sensor->segmentation.labels, nominal, sensor->initial).rms_m;
  if (frame.ground_truth) {
    sensor->error = ComparePoses(pose, *frame.ground_truth);
    sensor->initial_error = ComparePoses(sensor->initial, *frame.ground_truth);
  }
  std::optional<ContradictedSensors> contradiction;
  if (sensor->together)
    contradiction = {sensor->disagrees_with, ComparePoses(*sensor->together, pose)};
  const std::optional<Finding> weakness = FindWeakness(
      {quality, pose, sensor->covariance, refined.problem, contradiction, depth.same_depth_as,
       placed.suspect_intrinsics, suspect_lens, placed.by_neighbours, labelled.other_pose,
       labelled.floor_would_tell, frame.quarter_turns != kAutoTurns, placed.visible_by_geometry},
      options.verdict);
  sensor->status = SensorStatus::kOk;
  if (weakness) SetFinding(SensorStatus::kWeak, *weakness, sensor);
  DemoteIfNotFinite(sensor);
}

void JudgeTwins(const VerdictOptions& options, std::vector<SensorResult>* sensors) {
  std::vector<std::string> names;
  std::vector<std::optional<Pose>> poses;
  for (const SensorResult& sensor : *sensors) {
    names.push_back(sensor.name);
    poses.push_back(sensor.structure_from_sensor);
  }
  const std::vector<std::optional<Finding>> twins = FindTwins(names, poses, options);
  for (std::size_t i = 0; i < twins.size(); ++i) {
    if (twins[i]) SetFinding(SensorStatus::kWeak, *twins[i], &(*sensors)[i]);
  }
}

std::optional<SetDistances> MeasureSetDistances(const std::vector<SensorResult>& sensors,
                                                const Structure& built) {
  std::vector<Eigen::Vector3d> captured;
  for (const SensorResult& sensor : sensors) {
    if (!sensor.structure_from_sensor) continue;
    const std::vector<Eigen::Vector3d> points =
        LabelledPoints(Corrected(sensor.view, sensor.depth_gain, sensor.depth_offset_m),
                       sensor.segmentation.labels, *sensor.structure_from_sensor);
    captured.insert(captured.end(), points.begin(), points.end());
  }
  return CompareWithSurface(captured, built);
}

}  // namespace

CalibrationResult JudgeSensors(const std::vector<SensorFrame>& frames, const Structure& structure,
                               StageResults stages, const JudgeOptions& options) {
  CalibrationResult result;
  result.sensors.resize(frames.size());
  std::vector<std::size_t> placed;  // the sensor of each refined one
  for (std::size_t i = 0; i < frames.size(); ++i) {
    SensorResult& sensor = result.sensors[i];
    LabelledView& labelled = stages.labelled[i];
    sensor.name = frames[i].name;
    sensor.intrinsics = stages.lenses.Effective(i);
    sensor.intrinsics_given = frames[i].intrinsics;
    TakeLens(stages.lenses, stages.refined, i, &sensor);
    sensor.view = std::move(stages.views[i]);
    sensor.segmentation = std::move(labelled.segmentation);
    sensor.quarter_turns = labelled.quarter_turns;
    if (const auto* failure = std::get_if<Finding>(&stages.placements[i])) {
      SetFinding(SensorStatus::kFailed, *failure, &sensor);
      continue;
    }
    TakeRefinement(stages.refined.frames[placed.size()],
                   std::get<PlacedSensor>(stages.placements[i]).InitialPoseOf(labelled.initial),
                   &sensor);
    sensor.initial_source = SourceOf(std::get<PlacedSensor>(stages.placements[i]), labelled);
    placed.push_back(i);
  }
  for (std::size_t j = 0; j < placed.size(); ++j) {
    if (!stages.refined.frames[j].refused_fit) continue;
    for (const int other : stages.refined.frames[j].refused_fit->contradicts) {
      result.sensors[placed[j]].disagrees_with.push_back(
          frames[placed[static_cast<std::size_t>(other)]].name);
    }
  }
  ParallelFor(placed.size(), options.threads, [&](std::size_t j) {
    const std::size_t i = placed[j];
    Judge(frames[i], std::get<PlacedSensor>(stages.placements[i]), stages.depths[i],
          stages.labelled[i], stages.suspect_lenses[i], stages.refined.frames[j], structure,
          stages.refined.placements.front().built, options, &result.sensors[i]);
  });
  JudgeTwins(options.verdict, &result.sensors);
  result.metrics = MeasureSetDistances(result.sensors, stages.refined.placements.front().built);
  for (const RefinedPair& pair : stages.refined.pairs) {
    result.pairs.push_back({frames[placed[static_cast<std::size_t>(pair.a)]].name,
                            frames[placed[static_cast<std::size_t>(pair.b)]].name, pair.overlap,
                            pair.rms});
  }
  result.assembly = std::move(stages.assembly);
  result.built = std::move(stages.refined.placements.front().built);
  result.boxes = std::move(stages.refined.placements.front().boxes);
  result.size_estimated = stages.refined.size_estimated;
  result.size_scale = stages.refined.size_scale;
  result.sigma_size_scale = stages.refined.sigma_size_scale;
  return result;
}

}  // namespace volalign
