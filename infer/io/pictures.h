#pragma once

#include <vector>

#include "core/image.h"
#include "core/structure.h"
#include "infer/calibrate.h"

namespace volalign {

/// 0 to 1 as 0 to 255.
LabelImage ConfidenceImage(const Image<float>& confidence);

/// Depth, predicted labels over depth and, for a placed sensor, the structure as seen from the
/// estimated pose, side by side, turned upright by `turns`.
RgbImage SensorPicture(const SensorResult& sensor, const Structure& structure, int turns);

/// The turns that bring each sensor's picture upright. One without a pose is shown as most of the
/// others are mounted.
std::vector<int> UprightTurnsOf(const std::vector<SensorResult>& sensors);

}  // namespace volalign
