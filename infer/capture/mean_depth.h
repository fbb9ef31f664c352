#pragma once

#include <vector>

#include "infer/formats/depth_file.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// Sets the frame's depth from images of one still scene, which have one size, in units of
/// frame->depth_scale. Of several, each pixel becomes the mean of those of its non-zero values that
/// are near their (lower) median, so that no value is invented between foreground and background,
/// and depth_sigma the standard error of that mean, by the deviation from the median that 68 % of
/// the values keep.
void SetMeanDepth(const std::vector<StoredDepth>& images, SensorFrame* frame);

}  // namespace volalign
