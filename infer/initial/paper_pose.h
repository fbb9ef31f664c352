#pragma once

#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The estimator of the paper "Deep Soft Procrustes for Markerless Volumetric Sensor Alignment",
/// for comparison: the mean of each side's confident pixels against the side's centre, Procrustes
/// over all sides with at least patch.min_pixels of them. Keypoint pose and initial pose are the
/// same. Nothing is found where the centres of fewer than three sides, or of sides in a line, are
/// visible.
InitialPose EstimatePaperPose(const SensorView& view, const SegmentationResult& segmentation,
                              const Structure& structure, const InitialPoseOptions& options);

}  // namespace volalign
