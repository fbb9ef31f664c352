#include "infer/pose/shape_evidence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "core/visibility.h"

namespace volalign {

namespace {

/// Distance within which a point lies on a surface, in m, and per squared metre of depth.
constexpr double kTolerance = 0.03, kSquaredTolerance = 0.003;
/// m: nearer to a side's border, neither a normal nor a depth behind it says anything: the pose is
/// not refined yet.
constexpr double kBorder = 0.03;
/// Cosines of angles between normals: those of one surface (45 deg), and, of a surface that goes
/// on, (25 deg).
constexpr double kFacesAlike = 0.7, kGoesOnAlike = 0.9;
/// m: how far beyond a side's border is looked for surface that goes on, and from where on.
constexpr double kBeyondFrom = 0.02, kBeyondTo = 0.07;
/// m: nearer to the foot the floor begins.
constexpr double kFloorDistance = 0.05;
/// A plane of the structure is seen where so much of a side is measured, as a part of its exposed
/// area, or so much of a border, as a part of its length, and less than half as much goes on there.
constexpr double kLeastOfSide = 0.15, kLeastOfBorder = 0.25;
/// Planes are one whose normals are no farther apart than this (8 deg), and whose places than this,
/// m.
constexpr double kSameDirection = 0.99, kSamePlane = 0.025;

/// One ray, structure frame: p = origin + z * direction.
struct Ray {
  Eigen::Vector3d origin, direction;
  double measured = 0, expected = 0;
  int label = 0;           // of the side that is expected; 0: one without label, or none
  Eigen::Vector3d normal;  // measured; zero: not known
  bool room = false;       // measured on a plane of the room
};

double Tolerance(double z) { return kTolerance + kSquaredTolerance * z * z; }

/// A side's borders: at +u, -u, +v, -v.
constexpr int kBorders = 4;

/// How far a point of a side's plane lies beyond the side's border, m; negative within it.
/// `border`: the one that it lies farthest beyond, or nearest to.
double Beyond(const Side& side, const Eigen::Vector3d& p, int* border = nullptr) {
  const Eigen::Vector3d local = p - side.centre;
  const double u = local.dot(side.axis_u), v = local.dot(side.axis_v);
  const double beyond_u = std::abs(u) - side.half_u, beyond_v = std::abs(v) - side.half_v;
  if (border) *border = beyond_u > beyond_v ? (u > 0 ? 0 : 1) : (v > 0 ? 2 : 3);
  return std::max(beyond_u, beyond_v);
}

/// What one side was found to be.
struct SideShape {
  double explained = 0;
  std::array<double, kBorders> border_ends{}, border_goes_on{};
};

/// A plane of the structure.
struct StructurePlane {
  Eigen::Vector3d normal;
  double offset = 0;
};

/// The plane of the face that a side has beyond its border.
StructurePlane PlaneBeyond(const Side& side, int border) {
  const Eigen::Vector3d& axis = border < 2 ? side.axis_u : side.axis_v;
  const Eigen::Vector3d normal = border % 2 == 0 ? axis : Eigen::Vector3d(-axis);
  return {normal, normal.dot(side.centre) + (border < 2 ? side.half_u : side.half_v)};
}

double BorderLength(const Side& side, int border) {
  return 2 * (border < 2 ? side.half_v : side.half_u);
}

void AddPlane(const StructurePlane& plane, std::vector<StructurePlane>* planes) {
  const bool known = std::any_of(planes->begin(), planes->end(), [&](const StructurePlane& other) {
    return other.normal.dot(plane.normal) > kSameDirection &&
           std::abs(other.offset - plane.offset) < kSamePlane;
  });
  if (!known) planes->push_back(plane);
}

/// The planes that one side shows.
void AddPlanes(const Side& side, const SideShape& shape, std::vector<StructurePlane>* planes) {
  if (!(shape.explained > kLeastOfSide * side.exposed_area)) return;
  AddPlane({side.normal, side.normal.dot(side.centre)}, planes);
  for (int border = 0; border < kBorders; ++border) {
    const auto b = static_cast<std::size_t>(border);
    const double least = kLeastOfBorder * BorderLength(side, border) * (kBeyondTo - kBeyondFrom);
    if (shape.border_ends[b] > std::max(least, 2 * shape.border_goes_on[b]))
      AddPlane(PlaneBeyond(side, border), planes);
  }
}

class Measurement {
 public:
  Measurement(const SensorView& view, const Structure& structure, const Eigen::Vector3d& origin)
      : view_(view),
        structure_(structure),
        foot_(structure.FloorHeight()),
        shapes_(structure.sides().size()) {
    for (std::size_t i = 0; i < structure.sides().size(); ++i) {
      const Side& side = structure.sides()[i];
      if (side.exposed_area > 0 && side.normal.dot(origin - side.centre) > 0) facing_.push_back(i);
    }
  }

  void AddStructure(const Ray& ray) {
    const Eigen::Vector3d hit = ray.origin + ray.expected * ray.direction;
    const Side& side =
        ray.label > 0
            ? structure_.SideOfLabel(ray.label)
            : structure_.sides()[static_cast<std::size_t>(DistanceToSurface(structure_, hit).side)];
    const double area = Area(ray, side, ray.expected);
    const double tolerance = Tolerance(ray.measured);
    const Eigen::Vector3d p = ray.origin + ray.measured * ray.direction;
    const bool inner = Beyond(side, hit) < -kBorder;
    const bool near = std::abs(ray.measured - ray.expected) <= tolerance;
    if (near || DistanceToSurface(structure_, p).distance <= tolerance) {
      const bool known = near && inner && ray.normal.squaredNorm() > 0;
      if (known && ray.normal.dot(side.normal) < kFacesAlike) {
        evidence_.turned += area;
      } else if (ray.room) {
        evidence_.larger += area;
      } else {
        shapes_[static_cast<std::size_t>(&side - structure_.sides().data())].explained += area;
      }
    } else if (ray.measured < ray.expected) {
      evidence_.occluded += area;
    } else if (inner) {
      evidence_.see_through += area;
    }
  }

  void AddBeyond(const Ray& ray) {
    for (const std::size_t index : facing_) {
      const Side& side = structure_.sides()[index];
      const double slope = side.normal.dot(ray.direction);
      if (!(slope < 0)) continue;
      const double t = side.normal.dot(side.centre - ray.origin) / slope;
      const double tolerance = Tolerance(t);
      if (ray.expected > 0 && ray.expected < t + 2 * tolerance) continue;
      const Eigen::Vector3d p = ray.origin + t * ray.direction;
      int border = 0;
      const double beyond = Beyond(side, p, &border);
      if (beyond < kBeyondFrom || beyond > kBeyondTo || p.y() < foot_ + kFloorDistance) continue;
      if (!(ray.measured > 0) || ray.measured > t + 2 * tolerance) {
        shapes_[index].border_ends[static_cast<std::size_t>(border)] += Area(ray, side, t);
      } else if (std::abs(ray.measured - t) < tolerance &&
                 ray.normal.dot(side.normal) > kGoesOnAlike) {
        shapes_[index].border_goes_on[static_cast<std::size_t>(border)] += Area(ray, side, t);
      }
    }
  }

  ShapeEvidence Result() const {
    ShapeEvidence evidence = evidence_;
    std::vector<StructurePlane> planes;
    for (std::size_t i = 0; i < shapes_.size(); ++i) {
      const SideShape& shape = shapes_[i];
      double goes_on = 0, ends = 0;
      for (std::size_t b = 0; b < kBorders; ++b) {
        goes_on += shape.border_goes_on[b];
        ends += shape.border_ends[b];
      }
      evidence.goes_on += goes_on;
      evidence.ends += ends;
      (goes_on > ends ? evidence.larger : evidence.explained) += shape.explained;
      if (goes_on <= ends) AddPlanes(structure_.sides()[i], shape, &planes);
    }
    evidence.planes = static_cast<int>(planes.size());
    return evidence;
  }

 private:
  double Area(const Ray& ray, const Side& side, double z) const {
    constexpr double kGrazing = 0.1;
    const double cosine =
        std::max(std::abs(side.normal.dot(ray.direction)), kGrazing * ray.direction.norm());
    return z * z * view_.pixel_solid_angle / cosine;
  }

  const SensorView& view_;
  const Structure& structure_;
  double foot_;
  std::vector<std::size_t> facing_;  // sides, by index
  std::vector<SideShape> shapes_;    // of every side
  ShapeEvidence evidence_;
};

}  // namespace

ShapeEvidence MeasureShape(const SurfaceView& surface, const Structure& structure,
                           const Pose& structure_from_sensor) {
  const SensorView& view = surface.view;
  const StructureView model = CastView(structure, view.rays, structure_from_sensor);
  Measurement measurement(view, structure, structure_from_sensor.translation());
  // Rays that pass by farther than this show nothing of the structure or beside it.
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  double radius = 0;
  for (const Side& side : structure.sides()) middle += side.centre;
  middle /= static_cast<double>(structure.sides().size());
  for (const Side& side : structure.sides()) {
    radius = std::max(radius, (side.centre - middle).norm() + std::hypot(side.half_u, side.half_v));
  }
  const Eigen::Vector3d centre = structure_from_sensor.inverse() * middle;
  const double reach = radius + 2 * kBeyondTo;
  const double clearance = centre.squaredNorm() - reach * reach;

  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const Eigen::Vector3d direction(view.rays.at(u, v).x(), view.rays.at(u, v).y(), 1);
      const double along = direction.dot(centre);
      if (clearance > 0 && (along < 0 || along * along < clearance * direction.squaredNorm())) {
        continue;
      }
      const Ray ray{structure_from_sensor.translation(),
                    structure_from_sensor.linear() * direction,
                    view.depth(u, v),
                    model.depth(u, v),
                    model.labels(u, v),
                    structure_from_sensor.linear() * surface.normals(u, v).cast<double>(),
                    surface.room(u, v) != 0};
      if (ray.expected > 0 && ray.measured > 0) measurement.AddStructure(ray);
      measurement.AddBeyond(ray);
    }
  }
  return measurement.Result();
}

}  // namespace volalign
