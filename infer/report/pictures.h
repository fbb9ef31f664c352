#pragma once

#include <vector>

#include "core/base/image.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/panels.h"

namespace volalign {

/// Converts 0 to 1 into 0 to 255.
LabelImage ConfidenceImage(const Image<float>& confidence);

/// A frame's panels side by side under the sensor's name, status and figures. Each has its caption
/// and its scale. `caption_labels`: with a legend of the sides' colours below.
RgbImage SensorPicture(const SensorOutcome& sensor, const FramePanels& panels,
                       const Structure& structure, bool caption_labels);

/// The sensors' pictures, and one legend of the sides' colours below them all.
RgbImage OverviewPicture(const std::vector<RgbImage>& pictures, const Structure& structure);

}  // namespace volalign
