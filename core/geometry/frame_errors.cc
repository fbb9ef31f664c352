#include "core/geometry/frame_errors.h"

#include <algorithm>
#include <cmath>

namespace volalign {

namespace {

constexpr double kRise = 0.02;  // m: least rise of a box in front of a side for a seam
/// Share of the floor's reach. Light from a box, which is not wider than that, falls off sooner
/// (measured as bounce_m is).
constexpr double kReachOfBox = 0.75;

/// Factor on the multipath of a top, since walls and ceilings light it, too (measured as bounce_m
/// is).
constexpr double kOnTops = 1.3;

/// The point nearest to q of the triangles that rise in front of a side and face q.
std::optional<Eigen::Vector3d> NearestInFront(const Box& box, const Side& side,
                                              const Eigen::Vector3d& q) {
  const double scale = box.MeshScale(), plane = side.normal.dot(side.centre);
  const Eigen::Vector3d local = box.structure_from_box.inverse() * q / scale;
  const auto at = [&](const Eigen::Vector3d& p) {
    return Eigen::Vector3d(box.structure_from_box * Eigen::Vector3d(scale * p));
  };
  const auto rises = [&](int triangle) {
    const auto& corners = box.mesh->triangles()[static_cast<std::size_t>(triangle)];
    const Eigen::Vector3d& first = box.mesh->vertices()[static_cast<std::size_t>(corners[0])];
    if (!(box.mesh->NormalOf(triangle).dot(local - first) > 0)) return false;
    return std::any_of(corners.begin(), corners.end(), [&](int i) {
      return side.normal.dot(at(box.mesh->vertices()[static_cast<std::size_t>(i)])) > plane + kRise;
    });
  };
  const PartMesh::Nearest nearest = box.mesh->NearestPoint(local, rises);
  if (nearest.triangle < 0) return std::nullopt;
  return at(nearest.point);
}

/// Calls visit(nearest, share of its reach) for the floor of an upright side, and for each part
/// that rises in front of the side. `nearest` is the point nearest to q.
template <class Visit>
void ForEachSeam(const Structure& structure, const Side& side, const Eigen::Vector3d& q,
                 const Visit& visit) {
  if (std::abs(side.normal.y()) < 0.5)
    visit(Eigen::Vector3d(q.x(), std::min(q.y(), structure.FloorHeight()), q.z()), 1.0);
  const double plane = side.normal.dot(side.centre);
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    const Box& box = structure.boxes()[b];
    if (static_cast<int>(b) == side.box && !box.mesh) continue;
    const Eigen::Matrix3d box_from_structure = box.structure_from_box.linear().transpose();
    const Eigen::Vector3d half = 0.5 * box.size;
    const double front = side.normal.dot(box.structure_from_box.translation()) +
                         (box_from_structure * side.normal).cwiseAbs().dot(half);
    if (front < plane + kRise) continue;
    if (box.mesh) {
      if (const auto nearest = NearestInFront(box, side, q)) visit(*nearest, kReachOfBox);
      continue;
    }
    const Eigen::Vector3d in_box = box_from_structure * (q - box.structure_from_box.translation());
    visit(Eigen::Vector3d(box.structure_from_box * in_box.cwiseMax(-half).cwiseMin(half).eval()),
          kReachOfBox);
  }
}

}  // namespace

FrameErrorVector FrameErrorsAt(const DepthErrorModel& errors, const Eigen::Vector3d& p,
                               const Eigen::Vector3d& normal) {
  const Eigen::Vector3d ray = p / p.z();
  const double x = ray.x(), y = ray.y();
  // Derivatives of the logarithm of the depth along rows and columns, if the surface is a plane.
  const double faces = std::max(std::abs(normal.dot(ray)), kGrazing);
  const double along = normal.x() / faces, across = normal.y() / faces;
  const double s_xx = along * along * ray.squaredNorm() + 2 * along * x + 1;
  const double s_xy = along * across * ray.squaredNorm() + along * y + across * x;
  FrameErrorVector at;
  at << x, y, s_xy / s_xx, 0;
  return errors.TiltGrowth(p.z()) * at;
}

double SeamDistance(const Structure& structure, const Side& side, const Eigen::Vector3d& q) {
  double least = kNoSeam;
  ForEachSeam(structure, side, q, [&](const Eigen::Vector3d& nearest, double) {
    least = std::min(least, (q - nearest).norm());
  });
  return least;
}

Side FloorOf(const Structure& structure) {
  Side floor;
  floor.box = -1;
  floor.centre = {0, structure.FloorHeight(), 0};
  floor.normal = Eigen::Vector3d::UnitY();
  return floor;
}

double DiffuseMultipathShare(const Structure& structure, const Side& side, const Eigen::Vector3d& q,
                             const Eigen::Vector3d& eye, double reach) {
  double bounced = 0;
  ForEachSeam(structure, side, q, [&](const Eigen::Vector3d& nearest, double share) {
    const double distance = (q - nearest).norm();
    if (distance == 0) return;
    const double within = share * reach;
    const Eigen::Vector3d lamp = (eye - (nearest + within * side.normal)).normalized();
    const double lit = std::max(0.0, (q - nearest).dot(lamp) / distance);
    const double x = distance / within;
    bounced += x * std::exp(1 - x) * lit;
  });
  if (side.box >= 0 && side.normal.y() > 0.5) bounced *= kOnTops;
  return bounced / std::max(kGrazing, side.normal.dot((eye - q).normalized()));
}

}  // namespace volalign
