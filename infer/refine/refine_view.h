#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "core/structure.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A labelled point, sensor frame.
struct SidePoint {
  Eigen::Vector3d p;
  Eigen::Vector3d normal;  ///< towards the sensor; zero where no plane fits its neighbourhood
  int label = 0;
  int block = 0;  ///< image block, see RefineView
  bool held_out = false;
};

/// A point on the silhouette of a labelled side, where the depth behind it jumps: half a pixel
/// beyond the last one on the side, more where pixels are missing.
struct EdgePoint {
  Eigen::Vector3d p;
  Eigen::Vector3d
      outward;  ///< unit, sensor frame, in the side's measured plane, across the silhouette
  Eigen::Vector3d normal;  ///< of the side, as measured
  double sigma = 0;  ///< m: standard deviation if the edge were anywhere between the pixels on both
                     ///< sides of it
  double pixel = 0;  ///< m across the edge in the side's plane that one pixel covers
  int label = 0;
  int axis = 0;   ///< 0: found along an image row, 1: along a column
  int block = 0;  ///< image block, see RefineView
  bool held_out = false;
};

/// A point with a normal towards the sensor, sensor frame.
struct CloudPoint {
  Eigen::Vector3d p;
  Eigen::Vector3d normal;
  bool held_out = false;
};

/// What refinement needs of one sensor. Every fifth block of kBlock x kBlock pixels is held out:
/// its points never enter the solution, and tell whether it is better than where it began.
class RefineView {
 public:
  static constexpr int kBlock = 16;
  /// Index of the block of a pixel.
  static int BlockOf(int u, int v, int width) {
    return v / kBlock * (width / kBlock + 1) + u / kBlock;
  }

  struct Options {
    double min_confidence = 0.5;
    int max_side_points = 3000;
    int max_edge_points = 600;
    int cloud_stride = 2;
    double max_range = 7;  ///< m, of cloud points
  };

  RefineView(const SensorView& view, const SegmentationResult& segmentation,
             const Structure& structure, const Options& options);
  ~RefineView();
  RefineView(RefineView&&) noexcept;
  RefineView& operator=(RefineView&&) noexcept;

  std::vector<SidePoint> side_points;
  std::vector<EdgePoint> edge_points;
  std::vector<CloudPoint> cloud;

  /// Index of the cloud point nearest to p within `max_distance`, or -1. kd-tree (nanoflann).
  int Nearest(const Eigen::Vector3d& p, double max_distance) const;

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

/// Unit normal towards the sensor of the surface at a pixel, from the plane through its (2 radius +
/// 1)^2 neighbours on the same surface. Returns false where too few neighbours have depth or they
/// are bent: smallest variance over 8 % of the middle one.
bool PixelNormal(const SensorView& view, int u, int v, int radius, Eigen::Vector3d* normal);

}  // namespace volalign
