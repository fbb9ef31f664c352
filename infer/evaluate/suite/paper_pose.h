#pragma once

#include <optional>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The estimator of the paper "Deep Soft Procrustes for Markerless Volumetric Sensor Alignment", as
/// its authors published it (VCL3D/StructureNet, calibration.py), for comparison. A side counts if
/// more than 200 of 320x180 pixels show it, whatever their confidence. Its point is the median of
/// each coordinate of its measured pixels. Procrustes over all of them aligns these points with the
/// centroids of the sides' exposed areas. Nothing is found with fewer than three such sides, or
/// with sides in a line.
std::optional<Pose> EstimatePaperPose(const SensorView& view,
                                      const SegmentationResult& segmentation,
                                      const Structure& structure);

}  // namespace volalign
