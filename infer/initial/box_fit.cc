#include "infer/initial/box_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>

#include "infer/initial/stack_outline.h"

namespace volalign {

namespace {

/// Cosine of the angle between a point's normal and that of a side that it may lie on (50 deg).
constexpr double kNearlyFacesAlike = 0.64;
/// Scale of the Cauchy weights, as a share of the reach.
constexpr double kScale = 0.4;
/// Weight of a floor point; a point that lies beside its side counts this much along the side.
constexpr double kFloorWeight = 0.5, kBesideWeight = 0.5;
/// m: floor points farther from the structure's middle than its radius and this have no part.
constexpr double kFloorReach = 1.0;
/// Fixes directions that nothing else fixes: in points, at 1 m and 1 rad.
constexpr double kPrior = 0.01;
/// The steps end when one is shorter than this, m and rad.
constexpr double kConverged = kDepthStep;

struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();

  void Add(const Eigen::Vector3d& from_pivot, const Eigen::Vector3d& direction, double residual,
           double weight) {
    Vector6d derivative;
    derivative << direction, from_pivot.cross(direction);
    hessian += weight * derivative * derivative.transpose();
    gradient += weight * residual * derivative;
  }
};

struct Target {
  std::vector<const Side*> sides;  // that can be seen
  Eigen::Vector3d middle;
  double radius = 0;
  double floor = 0;
};

Target MakeTarget(const Structure& structure) {
  Target target;
  for (const Side& side : structure.sides()) {
    if (side.exposed_area > 0) target.sides.push_back(&side);
  }
  const Eigen::AlignedBox3d bounds = BoundsOf(structure);
  target.middle = bounds.center();
  target.radius = bounds.sizes().norm() / 2;
  target.floor = structure.FloorHeight();
  return target;
}

/// The nearest side within `reach` that faces as the point does; null where there is none. `gap`:
/// from the point to it.
const Side* NearestSide(const Target& target, const Eigen::Vector3d& p,
                        const Eigen::Vector3d& normal, double reach, Eigen::Vector3d* gap) {
  const Side* nearest = nullptr;
  double best = reach * reach;
  for (const Side* side : target.sides) {
    if (side->normal.dot(normal) < kNearlyFacesAlike) continue;
    if (std::abs(side->normal.dot(p - side->centre)) > reach) continue;
    const Eigen::Vector3d to = side->ClosestPoint(p) - p;
    if (to.squaredNorm() >= best) continue;
    best = to.squaredNorm();
    nearest = side;
    *gap = to;
  }
  return nearest;
}

void AddPoint(const Target& target, const OrientedPoint& point, const Pose& pose, double reach,
              bool floor, NormalEquations* equations) {
  const Eigen::Vector3d p = pose * point.p, normal = pose.linear() * point.normal;
  const double scale = kScale * reach;
  const auto weight = [&](double squared) { return 1 / (1 + squared / (scale * scale)); };
  Eigen::Vector3d gap;
  if (const Side* side = NearestSide(target, p, normal, reach, &gap)) {
    const double off = gap.dot(side->normal);
    equations->Add(p - target.middle, side->normal, off, weight(gap.squaredNorm()));
    const Eigen::Vector3d along = gap - off * side->normal;
    if (along.norm() > 0) {
      equations->Add(p - target.middle, along.normalized(), along.norm(),
                     kBesideWeight * weight(gap.squaredNorm()));
    }
  } else if (floor && normal.y() > kNearlyFacesAlike && std::abs(p.y() - target.floor) < reach) {
    const double off = target.floor - p.y();
    equations->Add(p - target.middle, Eigen::Vector3d::UnitY(), off,
                   kFloorWeight * weight(off * off));
  }
}

/// The points near the structure, thinned out to about fit.points.
std::vector<const OrientedPoint*> Near(const std::vector<OrientedPoint>& points,
                                       const Target& target, const BoxFit& fit, const Pose& pose) {
  const Eigen::Vector3d middle = pose.inverse() * target.middle;
  const double reach = target.radius + (fit.floor ? kFloorReach : fit.first_reach);
  std::vector<const OrientedPoint*> near;
  for (const OrientedPoint& point : points) {
    if ((point.p - middle).squaredNorm() < reach * reach) near.push_back(&point);
  }
  const std::size_t step = near.size() / fit.points + 1;
  std::vector<const OrientedPoint*> some;
  for (std::size_t i = step / 2; i < near.size(); i += step) some.push_back(near[i]);
  return some;
}

}  // namespace

Pose FitToBoxes(const std::vector<OrientedPoint>& points, const Structure& structure,
                const BoxFit& fit, Pose pose) {
  const Target target = MakeTarget(structure);
  const std::vector<const OrientedPoint*> near = Near(points, target, fit, pose);
  for (int step = 0; step < fit.steps; ++step) {
    const double done = fit.steps > 1 ? static_cast<double>(step) / (fit.steps - 1) : 1;
    const double reach = fit.first_reach * std::pow(fit.last_reach / fit.first_reach, done);
    NormalEquations equations;
    for (const OrientedPoint* point : near)
      AddPoint(target, *point, pose, reach, fit.floor, &equations);
    equations.hessian.diagonal().array() += kPrior;
    const Vector6d delta = equations.hessian.ldlt().solve(equations.gradient);
    const Eigen::Matrix3d turn = RotationExp(delta.tail<3>());
    pose.translation() =
        target.middle + turn * (pose.translation() - target.middle) + delta.head<3>();
    pose.linear() = turn * pose.linear();
    if (done == 1 && delta.norm() < kConverged) break;
  }
  return pose;
}

}  // namespace volalign
