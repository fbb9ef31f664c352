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

/// A sensor's measurements beside the structure, to compare with those of other sensors. The points
/// of one are surfaces that the other expects along its rays.
class MeasuredView {
 public:
  /// Points near the structure at one of `poses` (structure from sensor) are left out: the part
  /// of the structure beside a wrong pose is no evidence. The view is not kept.
  MeasuredView(const SensorView& view, const Structure& structure, const std::vector<Pose>& poses);

  /// The causes along this sensor's rays through the points of another one, at this pose, in
  /// independent cells. `sigma_m`: standard deviation of the distance of their surfaces, m, by both
  /// poses. Points beside the picture do not count.
  CauseShares Explain(const MeasuredView& other, const Pose& this_from_other, double sigma_m) const;

 private:
  struct Point {
    Eigen::Vector3d p;  // sensor frame, m
    double cells = 0;
  };

  /// Distance, m, between the rays of a pixel and its neighbours on the plane z = 1.
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

/// Are the sensors' poses right rather than one of them wrong? Natural logarithm of the odds. Only
/// points of one sensor that float before another one's measurements count. The causes are those of
/// one pair, or the sum over several. Evidence is not multiplied over pairs: a pose on the wrong
/// side of a room that looks alike from there fits all other sensors. Shared surfaces do not count,
/// as walls and floors lie in the same places from a wrong side, too.
double LogOddsOfPairs(const CauseShares& causes);

}  // namespace volalign
