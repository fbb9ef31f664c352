#include "infer/initial/view_fit.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/visibility.h"
#include "infer/depth/share_odds.h"
#include "infer/depth/surface_tolerance.h"
#include "infer/initial/stack_outline.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: surface that goes on is searched for from and up to here beyond a side's border.
constexpr double kBeyondFrom = kSamePlace, kBeyondTo = 0.07;

/// m^2 that count as one measurement. Cells of 5 to 20 cm tell right from wrong about equally well,
/// by the script below.
constexpr double kCell = 0.1 * 0.1;
// Shares among candidates in rendered and recorded frames, by shape_shares.py of commit 804ecf18.
// kIsIt: points where the structure should be that lie on it. kEnds: surroundings of its sides'
// borders where the surface ends. kPlanes: its unhidden planes that are found. kMeasured: its
// surface that is measured.
constexpr ShareOdds kIsIt{{3220, 9.4}, {1.82, 1.03}};
constexpr ShareOdds kEnds{{4350, 12.4}, {6.3, 0.68}};
constexpr ShareOdds kPlanes{{144, 0.51}, {2.15, 1.26}};
constexpr ShareOdds kMeasured{{9.2, 19.2}, {1.77, 16.4}};

/// One ray, structure frame: p = origin + z * direction.
struct Ray {
  Eigen::Vector3d origin, direction;
  double area = 0;  // m^2, of its pixel on the sensor's plane z = 1
  double measured = 0, expected = 0;
  int label = 0;           // of the expected side; 0: one without label, or none
  Eigen::Vector3d normal;  // measured; zero: not known
  bool room = false;       // measured on a plane of the room
};

/// Areas beyond one border of a side, m^2: shown at the pose, with nothing in front, and of these
/// where the surface ends or goes on.
struct BorderShape {
  double shown = 0, open = 0, ends = 0, goes_on = 0;
};

/// Areas of one side, m^2.
struct SideShape {
  double shown = 0, open = 0, explained = 0;
  double seen = 0;                   // explained, by Seen
  std::vector<BorderShape> borders;  // see Side::BorderAt
};

/// m^2 beyond a border that are needed to say something.
double LeastBeyond(const Border& border) {
  return kLeastShown * border.length * (kBeyondTo - kBeyondFrom);
}

/// Does a side end at its borders, as far as they tell?
bool EndsThere(const Side& side, const SideShape& shape) {
  double goes_on = 0, ends = 0;
  for (int border = 0; border < side.CountBorders(); ++border) {
    const BorderShape& beyond = shape.borders[static_cast<std::size_t>(border)];
    if (!(beyond.goes_on + beyond.ends > LeastBeyond(side.BorderAt(border)))) continue;
    goes_on += beyond.goes_on;
    ends += beyond.ends;
  }
  return goes_on <= ends;
}

/// A plane of the structure, and whether a side or a border shows it openly or confirms it.
struct StructurePlane {
  Eigen::Vector3d normal;
  double offset = 0;
  bool open = false, found = false;
};

void AddPlane(const StructurePlane& plane, std::vector<StructurePlane>* planes) {
  const auto known = std::find_if(planes->begin(), planes->end(), [&](const auto& other) {
    return other.normal.dot(plane.normal) > kSameNormal &&
           std::abs(other.offset - plane.offset) < kSamePlace;
  });
  if (known == planes->end()) {
    planes->push_back(plane);
  } else {
    known->open = known->open || plane.open;
    known->found = known->found || plane.found;
  }
}

/// The planes that one side shows.
void AddPlanes(const Side& side, const SideShape& shape, std::vector<StructurePlane>* planes) {
  const double least_of_side = kLeastShown * side.exposed_area;
  if (!(shape.shown > least_of_side)) return;
  const bool open = shape.open > least_of_side;
  const bool found = shape.explained > least_of_side && EndsThere(side, shape);
  AddPlane({side.normal, side.normal.dot(side.centre), open, found}, planes);
  if (side.outline) return;  // what joins a facet there may face any way
  for (int border = 0; border < side.CountBorders(); ++border) {
    const BorderShape& beyond = shape.borders[static_cast<std::size_t>(border)];
    const Border at = side.BorderAt(border);
    const double least = LeastBeyond(at);
    if (!(beyond.shown > least)) continue;
    StructurePlane plane{at.outward, at.outward.dot(at.middle), false, false};
    plane.open = open && beyond.open > least;
    plane.found = found && beyond.ends > std::max(least, 2 * beyond.goes_on);
    AddPlane(plane, planes);
  }
}

class Measurement {
 public:
  Measurement(const Structure& structure, const Eigen::Vector3d& origin,
              const DepthErrorModel& errors)
      : structure_(structure),
        tolerance_(SurfaceTolerance::AtRoughPose(errors)),
        foot_(structure.FloorHeight()),
        shapes_(structure.sides().size()) {
    for (std::size_t i = 0; i < structure.sides().size(); ++i) {
      const Side& side = structure.sides()[i];
      shapes_[i].borders.resize(static_cast<std::size_t>(side.CountBorders()));
      if (side.exposed_area > 0 && side.normal.dot(origin - side.centre) > 0) facing_.push_back(i);
    }
  }

  void AddStructure(const Ray& ray) {
    const Eigen::Vector3d hit = ray.origin + ray.expected * ray.direction;
    const Side& side =
        ray.label > 0
            ? structure_.SideOfLabel(ray.label)
            : structure_.sides()[static_cast<std::size_t>(DistanceToSurface(structure_, hit).side)];
    SideShape& shape = shapes_[static_cast<std::size_t>(&side - structure_.sides().data())];
    const double area = Area(ray, side, ray.expected), seen = Seen(ray, side, ray.expected);
    shape.shown += area;
    if (!(ray.measured > 0)) return;
    const double tolerance = tolerance_(ray.measured);
    const Eigen::Vector3d p = ray.origin + ray.measured * ray.direction;
    // Nearer to the border, neither a normal nor a depth behind it says anything.
    const bool inner = side.Beyond(hit) < -kRoughPose;
    const bool near = std::abs(ray.measured - ray.expected) <= tolerance;
    const bool on_surface = near || DistanceToSurface(structure_, p).distance <= tolerance;
    if (!on_surface && ray.measured < ray.expected) return;  // something hides it
    shape.open += area;
    if (on_surface) {
      const bool known = near && inner && ray.normal.squaredNorm() > 0;
      if (known && ray.normal.dot(side.normal) < kFacesAlike) {
        fit_.turned += seen;
      } else if (ray.room) {
        fit_.larger += seen;
      } else {
        shape.explained += area;
        shape.seen += seen;
      }
    } else if (inner) {
      fit_.behind += seen;
    }
  }

  void AddBeyond(const Ray& ray) {
    for (const std::size_t index : facing_) {
      const Side& side = structure_.sides()[index];
      const double slope = side.normal.dot(ray.direction);
      if (!(slope < 0)) continue;
      const double t = side.normal.dot(side.centre - ray.origin) / slope;
      const double tolerance = tolerance_(t);
      if (ray.expected > 0 && ray.expected < t + 2 * tolerance) continue;
      const Eigen::Vector3d p = ray.origin + t * ray.direction, local = p - side.centre;
      if (std::abs(side.axis_u.dot(local)) > side.half_u + kBeyondTo ||
          std::abs(side.axis_v.dot(local)) > side.half_v + kBeyondTo)
        continue;
      int border = 0;
      const double distance = side.Beyond(p, &border);
      if (distance < kBeyondFrom || distance > kBeyondTo || p.y() < foot_ + kRoughPose) continue;
      BorderShape& beyond = shapes_[index].borders[static_cast<std::size_t>(border)];
      const double area = Area(ray, side, t);
      beyond.shown += area;
      if (ray.measured > 0 && ray.measured < t - tolerance) continue;
      beyond.open += area;
      if (!(ray.measured > 0) || ray.measured > t + 2 * tolerance) {
        beyond.ends += area;
      } else if (std::abs(ray.measured - t) < tolerance &&
                 ray.normal.dot(side.normal) > kOnePlane) {
        beyond.goes_on += area;
      }
    }
  }

  ViewFit Result() const {
    ViewFit fit = fit_;
    for (const Side& side : structure_.sides())
      fit.surface += side.label > 0 ? side.exposed_area : 0;
    std::vector<StructurePlane> planes;
    for (std::size_t i = 0; i < shapes_.size(); ++i) {
      const SideShape& shape = shapes_[i];
      for (const BorderShape& border : shape.borders) {
        fit.goes_on += border.goes_on;
        fit.ends += border.ends;
      }
      (EndsThere(structure_.sides()[i], shape) ? fit.explained : fit.larger) += shape.seen;
      AddPlanes(structure_.sides()[i], shape, &planes);
    }
    for (const StructurePlane& plane : planes) {
      fit.open_planes += plane.open ? 1 : 0;
      fit.found_planes += plane.found ? 1 : 0;
    }
    return fit;
  }

 private:
  /// m^2 of a side that a ray covers.
  static double Area(const Ray& ray, const Side& side, double z, double least_cosine = kGrazing) {
    const double cosine =
        std::max(std::abs(side.normal.dot(ray.direction)), least_cosine * ray.direction.norm());
    return z * z * ray.area / cosine;
  }

  /// Area, but at most twice the area across the ray. At a side seen edge-on, one row of pixels
  /// more or less would outweigh all others.
  static double Seen(const Ray& ray, const Side& side, double z) { return Area(ray, side, z, 0.5); }

  const Structure& structure_;
  SurfaceTolerance tolerance_;
  double foot_;
  std::vector<std::size_t> facing_;  // sides, by index
  std::vector<SideShape> shapes_;    // of every side
  ViewFit fit_;
};

}  // namespace

double ViewFit::LogOdds() const {
  return kIsIt.LogOdds(explained / kCell, contradicted() / kCell) +
         kEnds.LogOdds(ends / kCell, goes_on / kCell) +
         kPlanes.LogOdds(found_planes, open_planes - found_planes) +
         kMeasured.LogOdds(explained / kCell, std::max(0.0, surface - explained) / kCell);
}

ViewFit MeasureShape(const SensorSurface& surface, const Structure& structure,
                     const Pose& structure_from_sensor) {
  const SensorView& view = surface.view;
  const ExpectedView model = CastView(structure, view.rays, structure_from_sensor);
  Measurement measurement(structure, structure_from_sensor.translation(), view.errors);
  // Rays that pass by farther than this show nothing of the structure or beside it.
  const Eigen::AlignedBox3d bounds = BoundsOf(structure);
  const Eigen::Vector3d centre = structure_from_sensor.inverse() * bounds.center();
  const double reach = bounds.sizes().norm() / 2 + 2 * kBeyondTo;
  const double clearance = centre.squaredNorm() - reach * reach;

  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const Eigen::Vector3d direction = view.Ray(u, v);
      const double along = direction.dot(centre);
      if (clearance > 0 && (along < 0 || along * along < clearance * direction.squaredNorm())) {
        continue;
      }
      const Ray ray{structure_from_sensor.translation(),
                    structure_from_sensor.linear() * direction,
                    view.ray_areas(u, v),
                    view.depth(u, v),
                    model.depth(u, v),
                    model.labels(u, v),
                    structure_from_sensor.linear() * surface.normals(u, v).cast<double>(),
                    surface.room(u, v) != 0};
      if (ray.expected > 0) measurement.AddStructure(ray);
      measurement.AddBeyond(ray);
    }
  }
  return measurement.Result();
}

}  // namespace volalign
