#include "core/geometry/visibility.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace volalign {

namespace {

/// A part for the tests with rays: rotations and origins in its own frame.
struct LocalBox {
  const Box* box = nullptr;
  int first_side = 0;  // index into the structure's sides
  Eigen::Matrix3d box_from_ray;
  Eigen::Vector3d origin;  // ray origin in the box's frame
  Eigen::Vector3d half;
  // The sphere about the box, which excludes most rays.
  Eigen::Vector3d centre;  // from the origin, in the rays' frame
  double clearance = 0;    // square of the tangents to it; negative within it

  bool IsPassedBy(const Eigen::Vector3d& direction) const {
    const double along = direction.dot(centre);
    return clearance > 0 && (along < 0 || along * along < clearance * direction.squaredNorm());
  }
};

constexpr int kNoAxis = -1;
/// Rays of tiles of so many rows and columns are compared with the boxes together first, px.
constexpr int kTile = 8;
constexpr double kRounding = 1e-6;

/// Index among a box's sides.
int SideIndex(int axis, bool positive) {
  // kFaces: front +x, back -x, up +y, down -y, right +z, left -z.
  return axis * 2 + (positive ? 0 : 1);
}

/// Entry of the ray origin + t * direction into the box from outside. `side`: index among the box's
/// sides. Returns false if there is no hit.
bool SlabTest(const LocalBox& box, const Eigen::Vector3d& direction, double* t, int* side) {
  const Eigen::Vector3d d = box.box_from_ray * direction;
  double enter = -std::numeric_limits<double>::infinity();
  double leave = std::numeric_limits<double>::infinity();
  int enter_axis = kNoAxis;
  for (int i = 0; i < 3; ++i) {
    if (d[i] == 0) {
      if (std::abs(box.origin[i]) > box.half[i]) return false;
      continue;
    }
    const double inverse = 1 / d[i];
    double near = (-box.half[i] - box.origin[i]) * inverse;
    double far = (box.half[i] - box.origin[i]) * inverse;
    if (near > far) std::swap(near, far);
    if (near > enter) {
      enter = near;
      enter_axis = i;
    }
    leave = std::min(leave, far);
  }
  if (enter_axis == kNoAxis || !(enter > 0) || enter > leave) return false;
  *t = enter;
  *side = SideIndex(enter_axis, d[enter_axis] < 0);
  return true;
}

/// The same for a mesh, in whose frame lengths are divided by its scale.
bool MeshTest(const LocalBox& local, const Eigen::Vector3d& direction, double* t, int* side) {
  const double scale = local.box->MeshScale();
  const auto hit =
      local.box->mesh->FirstHit(local.origin / scale, local.box_from_ray * direction / scale);
  if (!hit) return false;
  *t = hit->t;
  *side = local.box->mesh->FacetOf(hit->triangle);
  return true;
}

std::vector<LocalBox> LocalBoxes(const Structure& structure, const Eigen::Vector3d& origin,
                                 const Eigen::Matrix3d& structure_from_ray) {
  std::vector<LocalBox> boxes;
  int first_side = 0;
  for (const Box& box : structure.boxes()) {
    const Pose box_from_structure = box.structure_from_box.inverse();
    const Eigen::Vector3d centre =
        structure_from_ray.transpose() * (box.structure_from_box.translation() - origin);
    boxes.push_back({&box, first_side, box_from_structure.linear() * structure_from_ray,
                     box_from_structure * origin, box.size / 2, centre,
                     centre.squaredNorm() - box.size.squaredNorm() / 4});
    first_side += box.CountSides();
  }
  return boxes;
}

RayHit FirstHit(const std::vector<LocalBox>& boxes, const Eigen::Vector3d& direction) {
  RayHit hit;
  for (const LocalBox& box : boxes) {
    double t = 0;
    int side = 0;
    if (box.IsPassedBy(direction)) continue;
    const bool hits =
        box.box->mesh ? MeshTest(box, direction, &t, &side) : SlabTest(box, direction, &t, &side);
    if (hits && t < hit.t) hit = {box.first_side + side, t};
  }
  return hit;
}

/// The boxes whose spheres meet the cone about the rays of a tile. A pixel without a ray is NaN.
std::vector<LocalBox> BoxesNear(const std::vector<LocalBox>& boxes, const RayTable& rays, int u0,
                                int u1, int v0, int v1) {
  std::array<Eigen::Vector3d, static_cast<std::size_t>(kTile * kTile)> directions;
  std::size_t count = 0;
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();
  for (int v = v0; v < v1; ++v) {
    for (int u = u0; u < u1; ++u) {
      const Eigen::Vector2f& ray = rays.at(u, v);
      if (ray.hasNaN()) continue;
      directions[count] = Eigen::Vector3d(ray.x(), ray.y(), 1).normalized();
      axis += directions[count++];
    }
  }
  axis.normalize();
  double cosine = 1;
  for (std::size_t i = 0; i < count; ++i) cosine = std::min(cosine, axis.dot(directions[i]));
  const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
  std::vector<LocalBox> near;
  for (const LocalBox& box : boxes) {
    // The cosine of the sum of the angles of cone and sphere, times the sphere's distance.
    const double limit = cosine * std::sqrt(std::max(0.0, box.clearance)) - sine * box.half.norm();
    if (box.clearance <= 0 || axis.dot(box.centre) > limit - kRounding * box.centre.norm())
      near.push_back(box);
  }
  return near;
}

}  // namespace

RayHit CastRay(const Structure& structure, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& direction) {
  return FirstHit(LocalBoxes(structure, origin, Eigen::Matrix3d::Identity()), direction);
}

ExpectedView CastView(const Structure& structure, const RayTable& rays,
                      const Pose& structure_from_sensor) {
  const std::vector<LocalBox> boxes =
      LocalBoxes(structure, structure_from_sensor.translation(), structure_from_sensor.linear());
  ExpectedView view{DepthImage(rays.width, rays.height), LabelImage(rays.width, rays.height)};
  for (int v0 = 0; v0 < rays.height; v0 += kTile) {
    for (int u0 = 0; u0 < rays.width; u0 += kTile) {
      const int v1 = std::min(v0 + kTile, rays.height), u1 = std::min(u0 + kTile, rays.width);
      const std::vector<LocalBox> near = BoxesNear(boxes, rays, u0, u1, v0, v1);
      if (near.empty()) continue;
      for (int v = v0; v < v1; ++v) {
        for (int u = u0; u < u1; ++u) {
          const Eigen::Vector2f& ray = rays.at(u, v);
          const RayHit hit = FirstHit(near, Eigen::Vector3d(ray.x(), ray.y(), 1));
          if (hit.side < 0) continue;
          view.depth(u, v) = static_cast<float>(hit.t);
          view.labels(u, v) = structure.sides()[static_cast<std::size_t>(hit.side)].label;
        }
      }
    }
  }
  return view;
}

SurfaceDistance DistanceToSurface(const Structure& structure, const Eigen::Vector3d& p) {
  SurfaceDistance best;  // `distance` is its square
  int first_side = 0;
  for (const Box& box : structure.boxes()) {
    const Eigen::Vector3d local =
        box.structure_from_box.linear().transpose() * (p - box.structure_from_box.translation());
    const Eigen::Vector3d beyond = local.cwiseAbs() - box.size / 2;
    int axis = 0;  // of the side: the first that p lies beyond or, within the box, the nearest
    const double farthest = beyond.maxCoeff(&axis);
    double squared = farthest > 0 ? beyond.cwiseMax(0).squaredNorm() : farthest * farthest;
    int side = 0;
    if (!box.mesh) {
      if (farthest > 0)
        for (axis = 0; !(beyond[axis] > 0);) ++axis;
      side = SideIndex(axis, local[axis] > 0);
    } else if (farthest <= 0 || squared < best.distance) {
      const double scale = box.MeshScale();
      const PartMesh::Nearest nearest = box.mesh->NearestPoint(local / scale);
      squared = scale * scale * nearest.squared_distance;
      side = box.mesh->FacetOf(nearest.triangle);
    }
    if (squared < best.distance) best = {squared, first_side + side};
    first_side += box.CountSides();
  }
  best.distance = std::sqrt(best.distance);
  return best;
}

std::vector<Eigen::Vector3d> SampleExposedSurface(const Structure& structure, double spacing) {
  std::vector<Eigen::Vector3d> points;
  for (const Side& side : structure.sides()) {
    if (side.label == 0) continue;
    const int nu = std::max(1, static_cast<int>(std::lround(2 * side.half_u / spacing)));
    const int nv = std::max(1, static_cast<int>(std::lround(2 * side.half_v / spacing)));
    for (int i = 0; i < nu; ++i) {
      for (int j = 0; j < nv; ++j) {
        const Eigen::Vector3d p = side.centre +
                                  side.half_u * ((2 * i + 1.0) / nu - 1) * side.axis_u +
                                  side.half_v * ((2 * j + 1.0) / nv - 1) * side.axis_v;
        if (side.outline && side.Beyond(p) > 0) continue;
        if (!structure.Contains(p + kTouching * side.normal)) points.push_back(p);
      }
    }
  }
  return points;
}

}  // namespace volalign
