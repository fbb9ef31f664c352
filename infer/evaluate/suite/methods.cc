#include "infer/evaluate/suite/methods.h"

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <utility>

#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/geometry/visibility.h"
#include "infer/calib/calibrate.h"
#include "infer/evaluate/suite/graph_icp.h"
#include "infer/evaluate/suite/markers.h"
#include "infer/evaluate/suite/paper_pose.h"
#include "infer/refine/refine.h"

namespace volalign {

namespace {

/// m: at an initial pose, a depth within so much of the model's belongs to the side there.
constexpr double kLabelDistance = 0.1;

/// Indices of the frames that have a pose.
std::vector<std::size_t> Placed(const FramePoses& poses) {
  std::vector<std::size_t> placed;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i]) placed.push_back(i);
  }
  return placed;
}

FramePoses RefineByGraph(const SuiteCapture& capture, const FramePoses& initial) {
  FramePoses refined(initial.size());
  std::vector<GraphFrame> views;
  const std::vector<std::size_t> placed = Placed(initial);
  for (const std::size_t i : placed) views.push_back({&capture.views[i], *initial[i]});
  const std::vector<Pose> poses = RefineGraph(capture.evaluation.structure, views);
  for (std::size_t k = 0; k < placed.size(); ++k) refined[placed[k]] = poses[k];
  return refined;
}

/// The model's labels at a pose, for depths near the model's.
SegmentationResult LabelsAt(const SensorView& view, const Structure& structure, const Pose& pose) {
  const ExpectedView model = CastView(structure, view.rays, pose);
  SegmentationResult result{LabelImage(view.width(), view.height()),
                            Image<float>(view.width(), view.height(), 0.0F)};
  for (std::size_t i = 0; i < result.labels.size(); ++i) {
    if (model.labels[i] == 0 || std::abs(view.depth[i] - model.depth[i]) > kLabelDistance) continue;
    result.labels[i] = model.labels[i];
    result.confidence[i] = 1;
  }
  return result;
}

/// Adds volalign's joint refinement of the initial poses, which label the pixels.
void RefineStatistically(const SuiteCapture& capture, int threads, MethodResult* method) {
  const FramePoses& initial = method->poses[PoseStage::kInitial];
  FramePoses refined(initial.size());
  method->corrections.resize(initial.size());
  const std::vector<std::size_t> placed = Placed(initial);
  RefineOptions options;
  options.threads = threads;
  std::vector<FrameInput> frames;
  for (const std::size_t i : placed) {
    const SensorView& view = capture.views[i];
    FrameInput frame;
    SensorPoints points =
        SamplePoints(view, LabelsAt(view, capture.evaluation.structure, *initial[i]),
                     capture.evaluation.structure, options);
    points.cloud = SampleCloud(view);
    frame.points = std::make_shared<const SensorPoints>(std::move(points));
    frame.start = *initial[i];
    frames.push_back(frame);
  }
  const RefineResult result = Refine(capture.evaluation.structure, frames, options);
  for (std::size_t k = 0; k < placed.size(); ++k) {
    refined[placed[k]] = result.frames[k].structure_from_sensor;
    method->corrections[placed[k]] = {result.frames[k].depth_gain, result.frames[k].depth_offset};
  }
  method->poses[PoseStage::kStatistical] = method->poses[PoseStage::kCorrected] =
      std::move(refined);
}

/// Labels of the network, and the paper's poses.
MethodResult RunNetwork(const SuiteCapture& capture, Segmenter& segmenter) {
  MethodResult result;
  std::vector<SegmentationRequest> requests;
  for (std::size_t i = 0; i < capture.views.size(); ++i) {
    // A frame whose turn is not known is turned as in the training.
    const SensorFrame& frame = capture.evaluation.frames[i];
    const int turns = frame.quarter_turns == kAutoTurns ? 0 : frame.quarter_turns;
    requests.push_back({&capture.views[i].depth, &frame.intrinsics, turns});
  }
  std::vector<SegmentationResult> segmented = segmenter.Segment(requests);
  for (std::size_t i = 0; i < capture.views.size(); ++i) {
    result.poses[PoseStage::kInitial].push_back(
        EstimatePaperPose(capture.views[i], segmented[i], capture.evaluation.structure));
    result.labels.push_back(std::move(segmented[i].labels));
  }
  return result;
}

MethodResult RunMarkers(const SuiteCapture& capture) {
  if (capture.infrared.size() != capture.views.size())
    throw Error("RunMethod: markers want an infrared picture of each frame");
  MethodResult result;
  for (std::size_t i = 0; i < capture.views.size(); ++i) {
    result.poses[PoseStage::kInitial].push_back(
        EstimateMarkerPose(capture.views[i], capture.infrared_intrinsics[i],
                           FindMarkers(capture.infrared[i], capture.evaluation.structure),
                           capture.evaluation.structure));
  }
  return result;
}

MethodResult RunVolalign(const SuiteCapture& capture, Segmenter& segmenter, int threads) {
  CalibrateOptions options;
  options.threads = threads;
  CalibrationResult calibration =
      Calibrate(capture.evaluation.frames, capture.evaluation.structure, segmenter, options);
  MethodResult result;
  for (FrameResult& sensor : calibration.sensors) {
    result.labels.push_back(std::move(sensor.segmentation.labels));
    result.poses[PoseStage::kInitial].push_back(
        sensor.structure_from_sensor ? std::optional<Pose>(sensor.initial) : std::nullopt);
    for (const PoseStage stage : {PoseStage::kStatistical, PoseStage::kCorrected})
      result.poses[stage].push_back(sensor.structure_from_sensor);
    result.corrections.push_back({sensor.depth_gain, sensor.depth_offset_m});
  }
  return result;
}

}  // namespace

bool HasModel(const SuiteMethod& method) {
  return method.kind == MethodKind::kMarkers ||
         std::filesystem::exists(FindInputFile(method.model));
}

std::vector<SensorView> ViewsAt(PoseStage stage, const SuiteCapture& capture,
                                const MethodResult& result) {
  if (stage != PoseStage::kCorrected) return capture.views;
  std::vector<SensorView> views;
  for (std::size_t i = 0; i < capture.views.size(); ++i) {
    const DepthCorrection& correction = result.corrections.at(i);
    views.push_back(Corrected(capture.views[i], correction.gain, correction.offset_m));
  }
  return views;
}

MethodResult RunMethod(const SuiteMethod& method, const SuiteCapture& capture, Segmenter* segmenter,
                       int threads) {
  if (method.kind == MethodKind::kVolalign) return RunVolalign(capture, *segmenter, threads);
  MethodResult result =
      method.kind == MethodKind::kMarkers ? RunMarkers(capture) : RunNetwork(capture, *segmenter);
  result.poses[PoseStage::kGraph] = RefineByGraph(capture, result.poses[PoseStage::kInitial]);
  if (method.statistical) RefineStatistically(capture, threads, &result);
  return result;
}

}  // namespace volalign
