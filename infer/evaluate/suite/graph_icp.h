#pragma once

#include <vector>

#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct GraphIcpOptions {
  int iterations = 25;
  double first_distance_m = 0.15;
  double last_distance_m = 0.03;
  double max_normal_angle_deg = 45;
  int max_points = 1500;
  double floor_margin_m = 0.02;
  double min_overlap = 0.1;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("iterations", iterations, "rounds of correspondences and one Gauss-Newton step each",
       AtLeast(1));
    ar("first_distance_m", first_distance_m,
       "distance within which points correspond in the first round, m. Points of a view within it, "
       "at the initial pose, belong to the structure",
       Above(0));
    ar("last_distance_m", last_distance_m,
       "distance within which points correspond in the last round, m", Above(0));
    ar("max_normal_angle_deg", max_normal_angle_deg,
       "largest angle between the normals of points that correspond, deg", Between(1, 90));
    ar("max_points", max_points, "approximate number of points per view", AtLeast(10));
    ar("floor_margin_m", floor_margin_m,
       "height below which points belong to the floor, at the initial pose, m", AtLeast(0));
    ar("min_overlap", min_overlap,
       "smallest share of a view's points that correspond to another view's, at the initial poses, "
       "for the two to be joined",
       Between(0, 1));
  }
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
