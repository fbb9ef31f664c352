#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"
#include "render/infrared.h"

namespace volalign {

/// The marker-based calibration that the paper compares with (section Results, a variant of
/// LiveScan3D). An ArUco marker (Garrido-Jurado et al. 2014; OpenCV's DICT_4X4_50, the label its
/// id) lies at the centre of each side. It is found in an infrared picture that is aligned with the
/// depth map. Procrustes aligns the markers' centres in space, by the depth there, with the sides'
/// centres.

/// One marker for each labelled side whose centre no other box covers.
std::vector<MarkerPrint> StructureMarkers(const Structure& structure);

/// A marker in a picture, px.
struct FoundMarker {
  int label = 0;
  std::array<Eigen::Vector2d, 4> corners;  ///< of the black square, clockwise from its top left
  Eigen::Vector2d centre;                  ///< intersection of the diagonals
};
/// The markers of StructureMarkers that OpenCV finds, without those seen at over 75 deg. Corners
/// are refined below a pixel.
std::vector<FoundMarker> FindMarkers(const GreyImage& infrared, const Structure& structure);

/// The pose of a depth sensor from the markers in its infrared picture. Nothing if those with a
/// depth fix no pose (kMinSecondSingularValue).
std::optional<Pose> EstimateMarkerPose(const SensorView& view, const Intrinsics& infrared,
                                       const std::vector<FoundMarker>& markers,
                                       const Structure& structure);

}  // namespace volalign
