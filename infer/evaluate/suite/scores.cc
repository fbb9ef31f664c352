#include "infer/evaluate/suite/scores.h"

#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/geometry/visibility.h"
#include "core/json/json_archive.h"
#include "infer/checks/pose_quality.h"

namespace volalign {

PoseScore ScorePose(const SensorView& view, const LabelImage& labels, const Structure& structure,
                    const Pose& structure_from_sensor, int min_pixels) {
  const ExpectedView model = CastView(structure, view.rays, structure_from_sensor);
  PoseScore score;
  score.miou_authors = MeanIou(labels, model.labels, view.depth, {structure.num_classes(), true});
  const auto classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<Eigen::Vector3d> sums(classes, Eigen::Vector3d::Zero());  // sensor frame
  std::vector<int> pixels(classes, 0);
  for (int v = 0; v < labels.height(); ++v) {
    for (int u = 0; u < labels.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      sums[labels(u, v)] += view.Point(u, v);
      ++pixels[labels(u, v)];
    }
  }
  double squares = 0;
  for (std::size_t k = 1; k < classes; ++k) {
    if (pixels[k] < min_pixels) continue;
    const Eigen::Vector3d mean = structure_from_sensor * (sums[k] / pixels[k]);
    squares += (mean - structure.SideOfLabel(static_cast<int>(k)).centre).squaredNorm();
    ++score.sides;
  }
  if (score.sides > 0) score.rmse_m = std::sqrt(squares / score.sides);
  return score;
}

ColumnStatistics Column(const std::vector<double>& values, const std::vector<int>& groups) {
  const Summary all = Summarise(values);
  ColumnStatistics column;
  column.count = static_cast<int>(values.size());
  column.mean = all.mean;
  column.std = all.std;
  column.rsd = all.rsd;
  std::map<int, std::vector<double>> by_group;
  for (std::size_t i = 0; i < values.size(); ++i) by_group[groups.at(i)].push_back(values[i]);
  std::vector<double> within;
  for (const auto& [group, members] : by_group) {
    if (members.size() > 1) within.push_back(Summarise(members).rsd);
  }
  if (!within.empty()) column.rsd_within = Summarise(within).mean;
  return column;
}

namespace {

constexpr char kScoresFormat[] = "volalign.suite_scores/1";

Pose TruePose(const EvaluationCapture& capture, std::size_t i) {
  return capture.nominal_from_built * *capture.frames[i].ground_truth;
}

constexpr double kSurfaceGrid = 0.005;  // m

/// The distances d1 and d2 between the points of the views with a pose and the structure's surface.
/// Nothing without points.
std::optional<SetDistances> Distances(const std::vector<SensorView>& views, const FramePoses& poses,
                                      const std::vector<LabelImage>& labels,
                                      const std::vector<Eigen::Vector3d>& surface) {
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i] || i >= labels.size()) continue;
    const std::vector<Eigen::Vector3d> own = LabelledPoints(views[i], labels[i], *poses[i]);
    points.insert(points.end(), own.begin(), own.end());
  }
  if (points.empty()) return std::nullopt;
  return CompareSets(points, surface);
}

struct NamedStage {
  const char* name;
  const FramePoses* poses;
  std::vector<SensorView> views;
};
std::vector<NamedStage> StagesOf(const SuiteCapture& capture, const MethodResult& result) {
  std::vector<NamedStage> stages;
  for (const auto& [stage, poses] : result.poses)
    stages.push_back({ToString(stage), &poses, ViewsAt(stage, capture, result)});
  return stages;
}

ViewScores ScoreView(const SuiteCapture& capture, const MethodResult& result,
                     const std::vector<NamedStage>& stages, std::size_t i, int min_pixels) {
  const Structure& structure = capture.evaluation.structure;
  const SensorView& view = capture.views[i];
  const SensorFrame& frame = capture.evaluation.frames[i];
  const LabelImage* labels = result.labels.empty() ? nullptr : &result.labels[i];
  ViewScores scores;
  scores.name = frame.name;
  for (const NamedStage& stage : stages) {
    ViewPoseScore score;
    if (const std::optional<Pose>& pose = (*stage.poses)[i]) {
      score.placed = true;
      if (labels) score.labels = ScorePose(stage.views[i], *labels, structure, *pose, min_pixels);
      if (frame.ground_truth) score.error = ComparePoses(*pose, TruePose(capture.evaluation, i));
    }
    scores.stages.push_back(score);
  }
  if (labels && frame.ground_truth)
    scores.floor = ScorePose(view, *labels, structure, TruePose(capture.evaluation, i), min_pixels);
  if (labels && !capture.evaluation.labels.empty()) {
    scores.miou_of_truth = MeanIou(*labels, capture.evaluation.labels[i], view.depth,
                                   {structure.num_classes(), false});
  }
  return scores;
}

}  // namespace

CaptureScores ScoreCapture(const SuiteCapture& capture, const MethodResult& result,
                           int min_pixels) {
  const std::vector<Eigen::Vector3d> surface =
      SampleExposedSurface(capture.evaluation.structure, kSurfaceGrid);
  const bool known = !capture.evaluation.labels.empty();
  const std::vector<LabelImage>& on_structure = known ? capture.evaluation.labels : result.labels;
  CaptureScores scores;
  const std::vector<NamedStage> stages = StagesOf(capture, result);
  for (const NamedStage& stage : stages) {
    StageScores of;
    of.stage = stage.name;
    if (const auto d = Distances(stage.views, *stage.poses, on_structure, surface)) {
      of.d1_m = d->d1;
      of.d2_m = d->d2;
    }
    scores.stages.push_back(of);
  }
  FramePoses truth;
  for (std::size_t i = 0; i < capture.views.size(); ++i) {
    scores.views.push_back(ScoreView(capture, result, stages, i, min_pixels));
    truth.push_back(capture.evaluation.frames[i].ground_truth
                        ? std::optional<Pose>(TruePose(capture.evaluation, i))
                        : std::nullopt);
  }
  if (const auto d = Distances(capture.views, truth, on_structure, surface)) {
    scores.d1_floor_m = d->d1;
    scores.d2_floor_m = d->d2;
  }
  return scores;
}

// The file's keys.

template <class Archive>
void Describe(Archive& ar, PoseScore& score) {
  ar("miou_authors", score.miou_authors);
  ar("sides", score.sides);
  ar.Optional("rmse_m", score.rmse_m);
}

template <class Archive>
void Describe(Archive& ar, ViewPoseScore& score) {
  ar("placed", score.placed);
  ar.Optional("labels", score.labels);
  ar.Optional("error", score.error);
}

template <class Archive>
void Describe(Archive& ar, ViewScores& scores) {
  ar("name", scores.name);
  ar("stages", scores.stages);
  ar.Optional("floor", scores.floor);
  ar.Optional("miou_of_truth", scores.miou_of_truth);
}

template <class Archive>
void Describe(Archive& ar, StageScores& scores) {
  ar("stage", scores.stage);
  ar.Optional("d1_m", scores.d1_m);
  ar.Optional("d2_m", scores.d2_m);
}

template <class Archive>
void Describe(Archive& ar, CaptureScores& scores) {
  ar.Constant("format", kScoresFormat);
  ar("dataset", scores.dataset);
  ar("set_up", scores.set_up);
  ar("capture", scores.capture);
  ar("method", scores.method);
  ar("stages", scores.stages);
  ar("views", scores.views);
  ar.Optional("d1_floor_m", scores.d1_floor_m);
  ar.Optional("d2_floor_m", scores.d2_floor_m);
  ar("seconds", scores.seconds);
}

namespace {

struct AllScores {
  std::vector<CaptureScores> captures;
};

}  // namespace

template <class Archive>
void Describe(Archive& ar, AllScores& all) {
  ar("captures", all.captures);
}

void WriteScores(const std::filesystem::path& path, const CaptureScores& scores) {
  WriteFileAtomically(path, WriteDescribed(scores, path.string(), 1));
}

std::string FormatScores(const std::vector<CaptureScores>& scores) {
  return WriteDescribed(AllScores{scores}, "suite.json", 1);
}

}  // namespace volalign
