#pragma once

#include <map>
#include <optional>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/suite/suite_config.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"
#include "render/infrared.h"

namespace volalign {

/// A capture with the input of the methods.
struct SuiteCapture {
  EvaluationCapture evaluation;
  std::vector<SensorView> views;  ///< of its frames
  /// Pictures of its frames; empty without infrared pictures.
  std::vector<GreyImage> infrared;
  std::vector<Intrinsics> infrared_intrinsics;
};

/// Poses of the frames; none for a frame that was not placed.
using FramePoses = std::vector<std::optional<Pose>>;

/// The depth correction of a sensor by a refinement: true depth = gain * measured depth + offset.
struct DepthCorrection {
  double gain = 1;
  double offset_m = 0;
};

/// A method's result for a capture.
struct MethodResult {
  std::vector<LabelImage> labels;            ///< predicted, of its frames; empty without labels
  std::map<PoseStage, FramePoses> poses;     ///< of the stages that the method has
  std::vector<DepthCorrection> corrections;  ///< of the corrected stage
};

/// Can the method run? It needs no model, or the file is there.
bool HasModel(const SuiteMethod& method);

/// The views for a stage's poses: with corrected depths, or as they are.
std::vector<SensorView> ViewsAt(PoseStage stage, const SuiteCapture& capture,
                                const MethodResult& result);

/// Runs a method. `segmenter`: of its model; markers do not use it. Throws Error for markers
/// without infrared pictures.
MethodResult RunMethod(const SuiteMethod& method, const SuiteCapture& capture, Segmenter* segmenter,
                       int threads);

}  // namespace volalign
