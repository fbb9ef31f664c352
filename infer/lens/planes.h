#pragma once

#include <Eigen/Core>
#include <vector>

#include "infer/view/sensor_view.h"

namespace volalign {

/// The points of one image block, kBlock pixels wide, on one surface. Sensor frame.
struct PlanePatch {
  Eigen::Vector3d p;    ///< their mean, m
  double variance = 0;  ///< m^2, of independent errors of that mean along the normal
};

/// A surface that is flat from each patch to the next: a wall, a floor, a table. It may be bent as
/// a whole if the intrinsics have another lens than the sensor.
struct LargePlane {
  std::vector<PlanePatch> patches;
  /// Area of the plane z = 1 that their blocks cover, m^2 (SensorView::ray_areas).
  double picture_area = 0;
};

/// The large planes of a view. Those with less than `min_picture_area` are left out. The default is
/// an eighteenth of an Azure Kinect's picture (1.96).
std::vector<LargePlane> FindLargePlanes(const SensorView& view, double min_picture_area = 0.11);

}  // namespace volalign
