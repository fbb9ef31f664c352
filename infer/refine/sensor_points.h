#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "core/geometry/kd_tree.h"
#include "core/geometry/structure.h"
#include "infer/lens/sensor_lens.h"
#include "infer/refine/options.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A labelled point, sensor frame.
struct SidePoint {
  Eigen::Vector3d p;
  /// Towards the sensor; zero where no plane fits its neighbourhood.
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  int label = 0;
  double sigma = 0;  ///< m: standard error of its depth over several frames; 0: not known
  int block = 0;     ///< of the image, see BlockIndex
  /// Standard deviation of the angle between the point and where its depth was measured. A stereo
  /// matcher measures evenly within half of its window, which may reach beyond the side. 0
  /// elsewhere.
  double lateral_sigma_rad = 0;
};

/// A point on the silhouette of a labelled side, where the depth behind it jumps. It lies half a
/// pixel beyond the last one on the side, more if pixels are missing.
struct EdgePoint {
  Eigen::Vector3d p;
  /// Unit, sensor frame, in the side's measured plane, across the silhouette.
  Eigen::Vector3d outward;
  Eigen::Vector3d normal;  ///< of the side, as measured
  /// m, standard deviation. The edge is anywhere between the pixels on both sides of it.
  double sigma = 0;
  double pixel = 0;  ///< m across the edge in the side's plane that one pixel covers
  int label = 0;
  int axis = 0;   ///< 0: found along an image row, 1: along a column
  int block = 0;  ///< of the image, see BlockIndex
};

/// A point with a normal towards the sensor, sensor frame.
struct CloudPoint {
  Eigen::Vector3d p;
  Eigen::Vector3d normal;
};

/// Cloud points with a search for the nearest one. Copies share them.
class SampledCloud {
 public:
  SampledCloud() = default;
  explicit SampledCloud(std::vector<CloudPoint> points);

  const std::vector<CloudPoint>& points() const;
  /// Index of the point nearest to p within `max_distance`, or -1.
  int Nearest(const Eigen::Vector3d& p, double max_distance) const;

 private:
  struct Points {
    std::vector<CloudPoint> all;
    KdTree tree;
  };
  std::shared_ptr<const Points> points_;  // null: none
};

/// Index of the square block of kBlock pixels that contains a pixel, in an image of this width.
int BlockIndex(int u, int v, int width);

/// The points of one sensor that refinement works on.
struct SensorPoints {
  std::vector<SidePoint> side_points;
  std::vector<EdgePoint> edge_points;
  /// Points to match with other sensors' clouds, whatever their labels. A sensor that is refined
  /// alone needs none.
  SampledCloud cloud;
  /// The intrinsics through which they were seen, and their change from the assumed ones. An image
  /// of 0 x 0 px: a lens that cannot be changed.
  Intrinsics intrinsics = {};
  LensChange lens = LensChange::Zero();
  /// The derivative of a point's ray by the lens.
  RayByLensMatrix RayByLensAt(const Eigen::Vector3d& p) const {
    if (intrinsics.width == 0) return RayByLensMatrix::Zero();
    return RayByLens(intrinsics, p.head<2>() / p.z());
  }
};

/// The points of a view that have a normal, from every second pixel of every second row.
SampledCloud SampleCloud(const SensorView& view);

/// The labelled points of a view, without a cloud. There are at most
/// RefineOptions::max_side_points, and at most max_edge_points silhouettes. The same view always
/// gives the same points.
SensorPoints SamplePoints(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const RefineOptions& options);

/// Unit normal towards the sensor of the surface at a pixel: the plane through its neighbours
/// within kNormalRadius on the same surface. Returns false if too few neighbours have depth, or if
/// they are bent: smallest variance over 8 % of the middle one.
bool PixelNormal(const SensorView& view, int u, int v, Eigen::Vector3d* normal);

}  // namespace volalign
