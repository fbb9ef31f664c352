#pragma once

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

/// A capture with what the methods look at.
struct SuiteStill {
  EvaluationStill still;
  std::vector<SensorView> views;  ///< of its frames
  /// Of its frames; empty where there are no infrared pictures.
  std::vector<GreyImage> infrared;
  std::vector<Intrinsics> infrared_intrinsics;
};

/// Poses of the frames, none where one was not placed.
using FramePoses = std::vector<std::optional<Pose>>;

/// What a refinement found out about a sensor's depth beside its pose: the true depth is gain *
/// measured + offset.
struct DepthCorrection {
  double gain = 1;
  double offset_m = 0;
};

/// What a method says about a capture.
struct MethodResult {
  std::vector<LabelImage> labels;  ///< predicted, of its frames; empty of a method without labels
  FramePoses initial;
  std::optional<FramePoses> graph, statistical;  ///< refined; absent where a method has not
  std::vector<DepthCorrection> corrections;      ///< that belong to `statistical`; as it, or empty
};

/// What a network sees of a capture: its frames, those whose turn is not known as its training has
/// them. Refers to the still.
std::vector<SegmentationRequest> RequestsOf(const SuiteStill& still);

/// The poses of a stage; null where the method has not got it.
const FramePoses* PosesAt(PoseStage stage, const MethodResult& result);

/// The views as a stage's poses are to be looked at: with corrected depths, or as they are.
std::vector<SensorView> ViewsAt(PoseStage stage, const SuiteStill& still,
                                const MethodResult& result);

/// Runs a method. `segmenter`: of its model; unused by markers. Throws Error for
/// markers without infrared pictures.
MethodResult RunMethod(const SuiteMethod& method, const SuiteStill& still, Segmenter* segmenter,
                       const SuiteConfig& suite, int threads);

}  // namespace volalign
