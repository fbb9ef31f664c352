#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>
#include <vector>

#include "core/geometry/kd_tree.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/depth/explain_ray.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What a sensor measured beside the structure, to be compared with what others measured: the
/// points of one are surfaces that the other expects along its rays.
class MeasuredView {
 public:
  /// Points near the structure at one of `poses` (structure from sensor) are left out: what a wrong
  /// pose leaves over of the structure is no evidence of anything beside it. The view is not kept.
  MeasuredView(const SensorView& view, const Structure& structure, const std::vector<Pose>& poses);

  /// The causes along this sensor's rays through the points of another one, where the two stand so,
  /// in independent cells. `sigma_m`: standard deviation of their surfaces' distance, m, by both
  /// poses. Points beside the picture count nothing.
  CauseShares Explain(const MeasuredView& other, const Pose& this_from_other, double sigma_m) const;

 private:
  struct Point {
    Eigen::Vector3d p;  // sensor frame, m
    double cells = 0;
  };

  /// Between the rays of a pixel and its neighbours on the plane z = 1, m.
  double PitchAt(int u, int v) const;

  std::vector<Point> points_;
  int stride_;                               // of view_ in the view that was given
  SensorView view_;                          // with few rays
  std::vector<std::pair<int, int>> pixels_;  // (u, v) of view_ that have a ray
  std::unique_ptr<KdTree> rays_;             // (x/z, y/z, 0) of pixels_
  double widest_pitch_ = 0;                  // over pixels_
};

/// The causes between two sensors, both ways, in independent cells; each counts once.
CauseShares ExplainPair(const MeasuredView& a, const MeasuredView& b, const Pose& a_from_b,
                        double sigma_m);

/// Do sensors stand so? Natural logarithm of the odds that their poses are right rather than one of
/// them wrong, by the points of one that float before what another one measured: of one pair, or of
/// several, whose cells are added. If a sensor fits one of the others from a wrong side of a room
/// that looks alike from there, it fits them all: evidence for a pose is not multiplied. How much
/// both of a pair measured of the same surfaces does not tell: walls and floors lie in the same
/// places from a wrong side, too.
double LogOddsOfPairs(const CauseShares& causes);

}  // namespace volalign
