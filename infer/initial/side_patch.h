#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Least pixels on the plane of a side that counts as found.
inline constexpr int kFewestSidePixels = 25;

/// A planar patch of pixels that carry one side's label. Sensor frame, metres.
struct SidePatch {
  int label = 0;
  std::vector<int> pixels;   ///< row-major indices of the inliers
  Eigen::Vector3d centroid;  ///< of the patch's area, not of its pixels
  Eigen::Vector3d normal;    ///< unit, towards the sensor
  double area = 0;           ///< m^2
  double normal_sigma = 0;   ///< rad, rough: large for a sliver
  double mean_confidence = 0;
};

/// Fits planes to each label's confident pixels by RANSAC. A patch is no larger than the side's
/// diagonal. A label that marks two surfaces gives two patches, the larger first. A handful of far
/// pixels with a wrong label therefore changes nothing. Deterministic.
std::vector<SidePatch> CollectPatches(const SensorView& view,
                                      const SegmentationResult& segmentation,
                                      const Structure& structure);

}  // namespace volalign
