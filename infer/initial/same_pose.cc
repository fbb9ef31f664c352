#include "infer/initial/same_pose.h"

#include <algorithm>

#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: bounds of the limit for a very small and a very large structure.
constexpr double kLeastStep = kRoughPose, kMostStep = 0.2;
constexpr double kPartOfEdge = 0.5;

}  // namespace

bool SamePose(const Structure& structure, const Pose& a, const Pose& b) {
  const Pose motion = b * a.inverse();
  double edge = kMostStep / kPartOfEdge;
  for (const Box& box : structure.boxes()) edge = std::min(edge, box.size.minCoeff());
  const double step = std::max(kPartOfEdge * edge, kLeastStep);
  for (const Box& box : structure.boxes()) {
    for (const Eigen::Vector3d& corner : box.Corners()) {
      if (!((motion * corner - corner).norm() <= step)) return false;
    }
  }
  return true;
}

}  // namespace volalign
