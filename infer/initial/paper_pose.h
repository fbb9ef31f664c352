#pragma once

#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The estimator of the paper "Deep Soft Procrustes for Markerless Volumetric Sensor Alignment", as
/// its authors published it (VCL3D/StructureNet, calibration.py), for comparison: of each side that
/// more than 200 of 320x180 pixels show, the median of each coordinate of its measured
/// pixels, whatever their confidence, against the centroid of what no other box covers of it;
/// Procrustes over all of them. Keypoint pose and initial pose are the same. Nothing is found where
/// fewer than three sides, or sides in a line, are visible.
InitialPose EstimatePaperPose(const SensorView& view, const SegmentationResult& segmentation,
                              const Structure& structure);

}  // namespace volalign
