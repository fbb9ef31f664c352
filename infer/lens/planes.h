#pragma once

#include <Eigen/Core>
#include <vector>

#include "infer/view/sensor_view.h"

namespace volalign {

/// The points of one image block, kBlock pixels wide, that lie on one surface. Sensor frame.
struct PlanePatch {
  Eigen::Vector3d p;    ///< their mean, m
  double variance = 0;  ///< m^2, of independent errors of that mean along the normal
};

/// A surface that is flat from each patch to the next: a wall, a floor, a table. It may be bent as
/// a whole, as a wall is that is seen through a lens that the intrinsics do not have.
struct LargePlane {
  std::vector<PlanePatch> patches;
  /// What their blocks cover of the plane z = 1, m^2 (SensorView::ray_areas).
  double picture_area = 0;
};

/// The large planes of a view. Those with less than `min_picture_area` are left out: the default is
/// an eighteenth of an Azure Kinect's picture (1.96).
std::vector<LargePlane> FindLargePlanes(const SensorView& view, double min_picture_area = 0.11);

}  // namespace volalign
