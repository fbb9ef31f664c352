#include "infer/initial/side_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>

#include "infer/initial/pose_candidates.h"
#include "infer/initial/visibility_correction.h"
#include "infer/view/held_out.h"

namespace volalign {

namespace {

/// Errors of neighbouring pixels are alike: so many make one observation, with this spread, m.
constexpr double kPixelsPerObservation = 200, kPointSigma = 0.005;
/// Spread of a centroid along its side, m.
constexpr double kCentroidSigma = 0.01;
/// Boxes stand some millimetres off their places, which shifts all points of a side alike, m.
constexpr double kPlacementSigma = 0.003;
/// Most points of a patch.
constexpr std::size_t kMostPoints = 400;
/// Scale of the Cauchy weights in the first step, halved in each further one down to the least, m.
constexpr double kFirstScale = 0.04, kLeastScale = 0.01;
constexpr int kMostHalvings = 8;
/// Information of a prior for directions that nothing fixes: of 1 m and 1 rad.
constexpr double kPriorInformation = 1;
/// The steps end when one is shorter than this, m and rad.
constexpr double kLeastSideStep = 1e-4;

/// Normal equations of a step [translation; rotation vector] about a pivot, structure frame.
struct PlaneEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
};

/// Derivative of `direction` . p with respect to the step.
Vector6d Derivative(const Eigen::Vector3d& p, const Eigen::Vector3d& pivot,
                    const Eigen::Vector3d& direction) {
  Vector6d derivative;
  derivative << direction, (p - pivot).cross(direction);
  return derivative;
}

void AddResidual(const Vector6d& derivative, double residual, double weight,
                 PlaneEquations* equations) {
  equations->hessian += weight * derivative * derivative.transpose();
  equations->gradient += weight * residual * derivative;
}

/// The distances of a patch's points from its side, of which an offset that they share is not
/// known. False if no point counts.
bool AddPatchPoints(const SensorView& view, const SidePatch& patch, const Side& side,
                    const Pose& pose, const Eigen::Vector3d& pivot, double scale,
                    PlaneEquations* equations) {
  const auto pixels = static_cast<double>(patch.pixels.size());
  const std::size_t stride = patch.pixels.size() / kMostPoints + 1;
  const double observations = std::max(1.0, pixels / kPixelsPerObservation);
  const double share =
      observations * static_cast<double>(stride) / pixels / (kPointSigma * kPointSigma);
  Matrix6d squares = Matrix6d::Zero();
  Vector6d moment = Vector6d::Zero(), mean = Vector6d::Zero();
  double total = 0, offset = 0;
  for (std::size_t k = stride / 2; k < patch.pixels.size(); k += stride) {
    const int u = patch.pixels[k] % view.width();
    const int v = patch.pixels[k] / view.width();
    if (HeldOut(u, v)) continue;
    const Eigen::Vector3d p = pose * view.Point(u, v);
    const Eigen::Vector3d gap = side.ClosestPoint(p) - p;
    const double residual = gap.dot(side.normal);
    const double weight = share / (1 + gap.squaredNorm() / (scale * scale));
    const Vector6d derivative = Derivative(p, pivot, side.normal);
    squares += weight * derivative * derivative.transpose();
    moment += weight * residual * derivative;
    mean += weight * derivative;
    offset += weight * residual;
    total += weight;
  }
  if (!(total > 0)) return false;
  mean /= total;
  offset /= total;
  // The shared offset is marginalised: the patch's own tilt and bend keep their weight.
  const double centre_weight = 1 / (1 / total + kPlacementSigma * kPlacementSigma);
  equations->hessian += squares + (centre_weight - total) * mean * mean.transpose();
  equations->gradient += moment + (centre_weight - total) * offset * mean;
  return true;
}

/// The distance, along the side, of a patch's centroid from that of what the side shows.
void AddPatchCentroid(const SidePatch& patch, const PatchKeypoint& keypoint, const Side& side,
                      const Pose& pose, const Eigen::Vector3d& pivot, PlaneEquations* equations) {
  const Eigen::Vector3d p = pose * patch.centroid;
  const Eigen::Vector3d gap = keypoint.point - p;
  const double u = gap.dot(side.axis_u), v = gap.dot(side.axis_v);
  const double variance = kCentroidSigma * kCentroidSigma;
  const double weight = Trust(patch) / variance / (1 + (u * u + v * v) / (4 * variance));
  AddResidual(Derivative(p, pivot, side.axis_u), u, weight, equations);
  AddResidual(Derivative(p, pivot, side.axis_v), v, weight, equations);
}

}  // namespace

Pose FitToSides(const SensorView& view, const std::vector<SidePatch>& patches,
                const Structure& structure, const InitialPoseOptions& options, Pose pose) {
  for (int step = 0; step < options.side_fit_steps; ++step) {
    const std::vector<PatchKeypoint> keypoints =
        VisibleKeypoints(view, patches, structure, options.keypoints, pose);
    const PatchSet agreeing = AgreeingPatches(patches, keypoints, structure, options,
                                              options.max_keypoint_error_m / kTightening, pose);
    if (agreeing.count() < 2) break;
    const double scale = std::max(kLeastScale, kFirstScale / (1 << std::min(step, kMostHalvings)));
    const Eigen::Vector3d pivot = pose * patches.front().centroid;
    PlaneEquations equations;
    for (std::size_t i = 0; i < patches.size(); ++i) {
      if (!agreeing[i]) continue;
      const Side& side = structure.SideOfLabel(patches[i].label);
      if (!AddPatchPoints(view, patches[i], side, pose, pivot, scale, &equations)) continue;
      if (keypoints[i].of_visible_part)
        AddPatchCentroid(patches[i], keypoints[i], side, pose, pivot, &equations);
    }
    equations.hessian.diagonal().array() += kPriorInformation;
    const Vector6d delta = equations.hessian.ldlt().solve(equations.gradient);
    const Eigen::Matrix3d turn = RotationExp(delta.tail<3>());
    pose.translation() = pivot + turn * (pose.translation() - pivot) + delta.head<3>();
    pose.linear() = turn * pose.linear();
    if (delta.head<3>().norm() < kLeastSideStep && delta.tail<3>().norm() < kLeastSideStep) break;
  }
  return pose;
}

}  // namespace volalign
