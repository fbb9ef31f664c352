#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct GraphIcpOptions {
  int iterations = 25;  ///< rounds of correspondences and one Gauss-Newton step each
  /// m, within which points correspond in the first round and in the last one. Points of a view
  /// within the first, at the initial pose, belong to the structure.
  double first_distance_m = 0.15, last_distance_m = 0.03;
  double max_normal_angle_deg = 45;  ///< between the normals of points that correspond
  int max_points = 1500;             ///< per view, approximately
  double floor_margin_m = 0.02;      ///< below it points belong to the floor, at the initial pose
  /// Smallest share of a view's points that correspond to another view's, at the initial poses, for
  /// the two to be joined.
  double min_overlap = 0.1;
};

/// A view and its initial pose.
struct GraphFrame {
  const SensorView* view = nullptr;
  Pose structure_from_sensor = Pose::Identity();
};

/// The dense refinement of the paper "Deep Soft Procrustes for Markerless Volumetric Sensor
/// Alignment" (section Results, after its references). It is iterated closest points with a
/// point-to-plane error over a graph. Nodes are the views and the structure's model, which is
/// fixed. Edges join each view with the model and with each view that overlaps it. All poses move
/// together. The paper leaves some choices open. Here correspondences are nearest points with
/// normals alike, all of weight one, within a distance that shrinks from round to round. A view's
/// points are those near the model at its initial pose, without the floor. Returns the refined
/// poses.
std::vector<Pose> RefineGraph(const Structure& structure, const std::vector<GraphFrame>& views,
                              const GraphIcpOptions& options = {});

}  // namespace volalign
