#include "infer/initial/oriented_points.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "core/base/lists.h"
#include "infer/depth/surface_tolerance.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

// Normals.
/// m: half the width of the surface that a normal is taken from.
constexpr double kNormalReach = 2 * kSamePlace;
/// Neighbours along each axis on each side, and pixels that they reach at most.
constexpr int kNeighbours = 2, kMostReach = 12;
/// Least neighbours of the 25, the pixel itself among them.
constexpr int kLeastNeighbours = 9;

// Planes.
/// Least share of all points' area that makes a plane.
constexpr double kLeastShare = 0.01;
/// Cells along the edge of a square as large as the smallest part to mark. Neighbouring occupied
/// cells belong together.
constexpr double kPartCells = 8;

bool Lies(const Eigen::Vector3d& p, const Eigen::Vector3d& normal, const RoomPlane& plane,
          const SurfaceTolerance& tolerance) {
  return std::abs(plane.normal.dot(p) - plane.offset) < tolerance(p.z()) &&
         plane.normal.dot(normal) > kOnePlane;
}

bool Lies(const OrientedPoint& point, const RoomPlane& plane, const SurfaceTolerance& tolerance) {
  return Lies(point.p, point.normal, plane, tolerance);
}

/// Visits free points, in steps that leave about `count` of all.
template <class Visit>
void VisitSome(const std::vector<OrientedPoint>& points, const std::vector<char>& taken,
               std::size_t count, const Visit& visit) {
  const std::size_t step = std::max<std::size_t>(1, points.size() / count);
  for (std::size_t i = step / 2; i < points.size(); i += step) {
    if (!taken[i]) visit(points[i]);
  }
}

RoomPlane BestTrial(const std::vector<OrientedPoint>& points, const std::vector<char>& taken,
                    const SurfaceTolerance& tolerance) {
  RoomPlane best;
  VisitSome(points, taken, kFewProbes, [&](const OrientedPoint& seed) {
    RoomPlane plane{seed.normal, seed.normal.dot(seed.p), 0};
    VisitSome(points, taken, kManyProbes, [&](const OrientedPoint& point) {
      if (Lies(point, plane, tolerance)) plane.area += point.area;
    });
    if (plane.area > best.area) best = plane;
  });
  return best;
}

/// The plane through the free points that lie on it, each weighted by its area.
RoomPlane Fit(const std::vector<OrientedPoint>& points, const std::vector<char>& taken,
              RoomPlane plane, const SurfaceTolerance& tolerance) {
  double weight = 0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (taken[i] || !Lies(points[i], plane, tolerance)) continue;
    weight += points[i].area;
    mean += points[i].area * points[i].p;
    squares += points[i].area * points[i].p * points[i].p.transpose();
  }
  if (!(weight > 0)) return plane;
  mean /= weight;
  const Eigen::Matrix3d covariance = squares / weight - mean * mean.transpose();
  const Eigen::Vector3d normal =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvectors().col(0);
  plane.normal = normal.dot(plane.normal) < 0 ? Eigen::Vector3d(-normal) : normal;
  plane.offset = plane.normal.dot(mean);
  return plane;
}

/// The pixels in one cell of a plane.
struct PlaneCell {
  double area = 0;  // m^2
  std::vector<std::pair<int, int>> pixels;
  bool visited = false;
};

/// Marks the pixels of the plane's parts that are larger than `largest` m^2. Neighbouring cells
/// belong to one part. A side of the structure may lie in one plane with a strip of a wall far
/// behind it.
void MarkLargeParts(const RoomPlane& plane, double largest, SensorSurface* surface) {
  const SensorView& view = surface->view;
  const SurfaceTolerance tolerance = SurfaceTolerance::OfPlane(view.errors);
  const Eigen::Vector3d x = plane.normal.unitOrthogonal(), y = plane.normal.cross(x);
  const double edge = std::sqrt(largest) / kPartCells;
  using Place = std::pair<int, int>;
  std::map<Place, PlaneCell> cells;
  view.VisitMeasured(1, [&](int u, int v) {
    const Eigen::Vector3d normal = surface->normals(u, v).cast<double>();
    const Eigen::Vector3d p = view.Point(u, v);
    if (!(normal.squaredNorm() > 0) || !Lies(p, normal, plane, tolerance)) return;
    PlaneCell& cell = cells[{static_cast<int>(std::floor(p.dot(x) / edge)),
                             static_cast<int>(std::floor(p.dot(y) / edge))}];
    cell.area += view.PixelArea(u, v, p.z(), normal);
    cell.pixels.emplace_back(u, v);
  });
  for (const auto& [first, cell] : cells) {
    std::vector<Place> part;
    double area = 0;
    const auto visit = [&](const Place& place) {
      const auto at = cells.find(place);
      if (at == cells.end() || std::exchange(at->second.visited, true)) return;
      area += at->second.area;
      part.push_back(place);
    };
    visit(Place(first));
    for (std::size_t i = 0; i < part.size(); ++i) {
      for (int k = 0; k < 9; ++k)
        visit(Place(part[i].first + k % 3 - 1, part[i].second + k / 3 - 1));
    }
    for (const Place& place : part) {
      if (!(area > largest)) break;
      for (const auto& [u, v] : cells.at(place).pixels) surface->room(u, v) = 1;
    }
  }
}

}  // namespace

Eigen::Vector3d NormalAt(const SensorView& view, int u, int v) {
  const double z = view.depth(u, v);
  if (!(z > 0)) return Eigen::Vector3d::Zero();
  const double pixels = kNormalReach / (z * std::sqrt(view.ray_areas(u, v)));
  const int step =
      std::clamp(static_cast<int>(std::lround(pixels / kNeighbours)), 1, kMostReach / kNeighbours);
  // A plane n . p = 1 is linear in the inverse depth: n . (x, y, 1) = 1 / z.
  const double jump = DepthJump(z);
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  int count = 0;
  for (int j = -kNeighbours; j <= kNeighbours; ++j) {
    for (int i = -kNeighbours; i <= kNeighbours; ++i) {
      const int x = u + i * step, y = v + j * step;
      if (!view.depth.Contains(x, y)) continue;
      const double near = view.depth(x, y);
      if (!(near > 0) || std::abs(near - z) > jump) continue;
      const Eigen::Vector3d ray = view.Ray(x, y);
      squares += ray * ray.transpose();
      moment += ray / near;
      ++count;
    }
  }
  if (count < kLeastNeighbours) return Eigen::Vector3d::Zero();
  Eigen::Matrix3d inverse;
  bool invertible = false;
  squares.computeInverseWithCheck(inverse, invertible);
  if (!invertible) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d normal = -(inverse * moment);
  return normal.allFinite() && normal.norm() > 0 ? Eigen::Vector3d(normal.normalized())
                                                 : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

SensorSurface MakeSensorSurface(const SensorView& view, double rays) {
  const int stride = StrideForRays(view.depth.size(), rays);
  SensorSurface surface;
  surface.view = Decimate(view, stride);
  surface.normals = Image<Eigen::Vector3f>(surface.view.width(), surface.view.height());
  surface.room = Image<std::uint8_t>(surface.view.width(), surface.view.height());
  const int first = stride / 2;
  for (int v = 0; v < surface.view.height(); ++v) {
    for (int u = 0; u < surface.view.width(); ++u)
      surface.normals(u, v) = NormalAt(view, first + u * stride, first + v * stride).cast<float>();
  }
  return surface;
}

SensorSurface Decimate(const SensorSurface& surface, int stride) {
  if (stride <= 1) return surface;
  return {Decimate(surface.view, stride), DecimateImage(surface.normals, stride),
          DecimateImage(surface.room, stride)};
}

std::vector<OrientedPoint> PointsOf(const SensorSurface& surface) {
  const SensorView& view = surface.view;
  std::vector<OrientedPoint> points;
  view.VisitMeasured(1, [&](int u, int v) {
    const Eigen::Vector3d normal = surface.normals(u, v).cast<double>();
    if (!(normal.squaredNorm() > 0) || surface.room(u, v)) return;
    const Eigen::Vector3d p = view.Point(u, v);
    points.push_back({p, normal, view.PixelArea(u, v, p.z(), normal)});
  });
  return points;
}

std::vector<RoomPlane> FindRoomPlanes(const std::vector<OrientedPoint>& points, int most,
                                      const DepthErrorModel& errors) {
  const SurfaceTolerance tolerance = SurfaceTolerance::OfPlane(errors);
  double all = 0;
  for (const OrientedPoint& point : points) all += point.area;
  std::vector<char> taken(points.size(), 0);
  std::vector<RoomPlane> planes;
  for (int k = 0; k < most; ++k) {
    RoomPlane plane = Fit(points, taken, BestTrial(points, taken, tolerance), tolerance);
    plane.area = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (taken[i] || !Lies(points[i], plane, tolerance)) continue;
      plane.area += points[i].area;
      taken[i] = 1;
    }
    if (!(plane.area > kLeastShare * all)) break;
    planes.push_back(plane);
  }
  SortLargestFirst(&planes, [](const RoomPlane& plane) { return plane.area; });
  return planes;
}

void MarkRoom(const std::vector<RoomPlane>& planes, double largest, SensorSurface* surface) {
  std::fill(surface->room.begin(), surface->room.end(), 0);
  for (const RoomPlane& plane : planes) {
    if (plane.area > largest) MarkLargeParts(plane, largest, surface);
  }
}

}  // namespace volalign
