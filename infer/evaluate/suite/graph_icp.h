#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

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
/// points are those near the model at its initial pose, without the floor. Two views are joined
/// if at least `min_overlap` of the points of one correspond to the other's at the initial poses.
/// Returns the refined poses.
std::vector<Pose> RefineGraph(const Structure& structure, const std::vector<GraphFrame>& views,
                              double min_overlap = 0.1);

}  // namespace volalign
