#include "core/geometry/part_mesh.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "core/base/error.h"

namespace volalign {

namespace {

constexpr double kWeld = 1e-5;           // m
constexpr double kFarthestVertex = 1e4;  // m, of a vertex from the origin
constexpr double kThinnest = 1e-6;       // m: the volume divided by the surface

using Triangle = PartMesh::Triangle;

/// One vertex for all that are nearer than kWeld.
void Weld(std::vector<Eigen::Vector3d>* vertices, std::vector<Triangle>* triangles) {
  using Cell = std::array<std::int64_t, 3>;
  std::map<Cell, std::vector<int>> cells;
  std::vector<Eigen::Vector3d> kept;
  std::vector<int> of(vertices->size());
  for (std::size_t i = 0; i < vertices->size(); ++i) {
    const Eigen::Vector3d& p = (*vertices)[i];
    const auto cell_of = [](double x) { return static_cast<std::int64_t>(std::floor(x / kWeld)); };
    const Cell cell{cell_of(p.x()), cell_of(p.y()), cell_of(p.z())};
    int same = -1;
    for (int k = 0; k < 27 && same < 0; ++k) {
      const auto found =
          cells.find({cell[0] + k % 3 - 1, cell[1] + k / 3 % 3 - 1, cell[2] + k / 9 - 1});
      if (found == cells.end()) continue;
      for (const int other : found->second)
        if ((kept[static_cast<std::size_t>(other)] - p).norm() < kWeld) same = other;
    }
    if (same < 0) {
      same = static_cast<int>(kept.size());
      kept.push_back(p);
      cells[cell].push_back(same);
    }
    of[i] = same;
  }
  *vertices = std::move(kept);
  std::vector<Triangle> whole;
  for (const Triangle& triangle : *triangles) {
    Triangle welded;
    for (std::size_t k = 0; k < 3; ++k) welded[k] = of[static_cast<std::size_t>(triangle[k])];
    if (welded[0] != welded[1] && welded[1] != welded[2] && welded[2] != welded[0])
      whole.push_back(welded);
  }
  // What is there twice counts once.
  std::set<Triangle> known;
  triangles->clear();
  for (const Triangle& triangle : whole) {
    Triangle turned = triangle;
    std::rotate(turned.begin(), std::min_element(turned.begin(), turned.end()), turned.end());
    if (known.insert(turned).second) triangles->push_back(triangle);
  }
}

double SixVolumes(const std::vector<Eigen::Vector3d>& vertices, const Triangle& t) {
  const auto at = [&](std::size_t k) { return vertices[static_cast<std::size_t>(t[k])]; };
  return at(0).dot(at(1).cross(at(2)));
}

/// Turns solids that are inside out. A surface that encloses a cavity is no solid: it lies within
/// the box around another one.
void TurnOutwards(const std::vector<Eigen::Vector3d>& vertices, std::vector<Triangle>* triangles) {
  std::vector<int> shell_of(vertices.size());  // the least vertex that is joined with it
  std::iota(shell_of.begin(), shell_of.end(), 0);
  const auto root = [&](int i) {
    while (shell_of[static_cast<std::size_t>(i)] != i)
      i = shell_of[static_cast<std::size_t>(i)] =
          shell_of[static_cast<std::size_t>(shell_of[static_cast<std::size_t>(i)])];
    return i;
  };
  for (const Triangle& t : *triangles) {
    const int a = root(t[0]), b = root(t[1]), c = root(t[2]), least = std::min({a, b, c});
    for (const int i : {a, b, c}) shell_of[static_cast<std::size_t>(i)] = least;
  }
  struct Shell {
    double volume = 0;
    Eigen::AlignedBox3d bounds;
  };
  std::map<int, Shell> shells;
  for (const Triangle& t : *triangles) {
    Shell& shell = shells[root(t[0])];
    shell.volume += SixVolumes(vertices, t);
    for (const int i : t) shell.bounds.extend(vertices[static_cast<std::size_t>(i)]);
  }
  std::set<int> inside_out;
  for (const auto& [index, shell] : shells) {
    const Eigen::AlignedBox3d bounds = shell.bounds;
    const bool is_cavity =
        std::any_of(shells.begin(), shells.end(), [&, own = index](const auto& other) {
          return other.first != own && other.second.volume > 0 &&
                 other.second.bounds.contains(bounds);
        });
    if (shell.volume < 0 && !is_cavity) inside_out.insert(index);
  }
  for (Triangle& t : *triangles)
    if (inside_out.count(root(t[0])) > 0) std::swap(t[1], t[2]);
}

/// Throws DataError for a surface that is not closed, or has no volume.
void RequireClosed(const std::vector<Eigen::Vector3d>& vertices,
                   const std::vector<Triangle>& triangles) {
  std::map<std::pair<int, int>, int> edges;  // its triangles one way less those the other way
  double volume = 0, area = 0;
  for (const Triangle& t : triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = t[k], b = t[(k + 1) % 3];
      edges[std::minmax(a, b)] += a < b ? 1 : -1;
    }
    const auto at = [&](std::size_t k) { return vertices[static_cast<std::size_t>(t[k])]; };
    volume += SixVolumes(vertices, t) / 6;
    area += (at(1) - at(0)).cross(at(2) - at(0)).norm() / 2;
  }
  const auto open =
      std::count_if(edges.begin(), edges.end(), [](const auto& edge) { return edge.second != 0; });
  if (open > 0) {
    throw DataError(fmt::format(
        "the surface is open, its triangles face different ways, or their corners do not meet: {} "
        "of {} edges have no second triangle. Close the surface, and let all normals point "
        "outwards",
        open, edges.size()));
  }
  if (std::abs(volume) <= kThinnest * area)
    throw DataError("the surface encloses no volume: a sheet is no target");
}

RTCDevice Device() {
  // As long as the program runs. One thread: others are not needed, and may not be wanted.
  static const RTCDevice device = rtcNewDevice("threads=1");
  if (!device) throw Error("Embree cannot be started");
  return device;
}

Eigen::Vector3d ClosestOn(const std::array<Eigen::Vector3d, 3>& t, const Eigen::Vector3d& p) {
  // Ericson, "Real-Time Collision Detection", 5.1.5.
  const Eigen::Vector3d ab = t[1] - t[0], ac = t[2] - t[0], ap = p - t[0];
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return t[0];
  const Eigen::Vector3d bp = p - t[1];
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return t[1];
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return t[0] + d1 / (d1 - d3) * ab;
  const Eigen::Vector3d cp = p - t[2];
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return t[2];
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return t[0] + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6)
    return t[1] + (d4 - d3) / (d4 - d3 + d5 - d6) * (t[2] - t[1]);
  const double sum = va + vb + vc;
  return t[0] + vb / sum * ab + vc / sum * ac;
}

/// Finds what no solid of the mesh covers.
void FindOpenCells(const PartMesh& mesh, Facet* facet) {
  Outline& outline = *facet->outline;
  int inside = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& at : GridOver(facet->half_u, facet->half_v)) {
    if (!outline.Contains(at)) continue;
    ++inside;
    const Eigen::Vector3d p = facet->centre + at.x() * facet->axis_u + at.y() * facet->axis_v;
    if (facet->flat && mesh.Contains(p + kTouching * facet->normal)) continue;
    outline.open_cells.push_back(at);
    sum += at;
  }
  const auto open = static_cast<double>(outline.open_cells.size());
  outline.open_area = inside > 0 ? outline.area * open / inside : outline.area;
  outline.open_centroid =
      open > 0 && open < inside ? Eigen::Vector2d(sum / open) : outline.centroid;
}

void PutLabelledFirst(std::vector<Facet>* facets, std::vector<int>* facet_of) {
  std::vector<std::size_t> order(facets->size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_partition(order.begin(), order.end(),
                        [&](std::size_t i) { return (*facets)[i].labelled; });
  std::vector<Facet> ordered;
  std::vector<int> place(facets->size());
  for (const std::size_t i : order) {
    place[i] = static_cast<int>(ordered.size());
    ordered.push_back(std::move((*facets)[i]));
  }
  *facets = std::move(ordered);
  for (int& facet : *facet_of) facet = place[static_cast<std::size_t>(facet)];
}

}  // namespace

std::vector<Eigen::Vector2d> GridOver(double half_u, double half_v) {
  constexpr int kCells = 64;
  std::vector<Eigen::Vector2d> middles;
  for (int i = 0; i < kCells * kCells; ++i) {
    middles.emplace_back(half_u * ((2 * (i / kCells) + 1.0) / kCells - 1),
                         half_v * ((2 * (i % kCells) + 1.0) / kCells - 1));
  }
  return middles;
}

struct PartMesh::Scene {
  explicit Scene(const std::vector<Eigen::Vector3d>& vertices,
                 const std::vector<Triangle>& triangles)
      : scene(rtcNewScene(Device())) {
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
    const RTCGeometry geometry = rtcNewGeometry(Device(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* points = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                               RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                                               vertices.size()));
    for (const Eigen::Vector3d& p : vertices)
      for (int axis = 0; axis < 3; ++axis) *points++ = static_cast<float>(p[axis]);
    auto* indices = static_cast<unsigned*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(unsigned), triangles.size()));
    for (const Triangle& triangle : triangles)
      for (const int i : triangle) *indices++ = static_cast<unsigned>(i);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
  }
  ~Scene() { rtcReleaseScene(scene); }
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  static RTCRayHit RayOf(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
    RTCRayHit ray{};
    const Eigen::Vector3f from = origin.cast<float>(), along = direction.cast<float>();
    ray.ray.org_x = from.x();
    ray.ray.org_y = from.y();
    ray.ray.org_z = from.z();
    ray.ray.dir_x = along.x();
    ray.ray.dir_y = along.y();
    ray.ray.dir_z = along.z();
    ray.ray.tfar = std::numeric_limits<float>::infinity();
    ray.ray.mask = ~0U;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    return ray;
  }

  /// Index of the first triangle along the ray; -1 if there is none.
  int FirstHit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, float* t) const {
    RTCRayHit ray = RayOf(origin, direction);
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &ray);
    *t = ray.ray.tfar;
    return ray.hit.geomID == RTC_INVALID_GEOMETRY_ID ? -1 : static_cast<int>(ray.hit.primID);
  }

  /// How often the ray leaves a solid, less how often it enters one.
  int Leaves(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
    struct Counting : RTCIntersectContext {
      int leaves = 0;
    } context;
    rtcInitIntersectContext(&context);
    context.filter = [](const RTCFilterFunctionNArguments* hit) {
      const auto& ray = *reinterpret_cast<const RTCRay*>(hit->ray);
      const auto& at = *reinterpret_cast<const RTCHit*>(hit->hit);
      const float slope = ray.dir_x * at.Ng_x + ray.dir_y * at.Ng_y + ray.dir_z * at.Ng_z;
      static_cast<Counting*>(hit->context)->leaves += slope > 0 ? 1 : -1;
      hit->valid[0] = 0;  // go on
    };
    RTCRayHit ray = RayOf(origin, direction);
    rtcIntersect1(scene, &context, &ray);
    return context.leaves;
  }

  RTCScene scene;
};

PartMesh::~PartMesh() = default;

std::shared_ptr<const PartMesh> PartMesh::Make(std::vector<Eigen::Vector3d> vertices,
                                               std::vector<Triangle> triangles) {
  for (const Triangle& triangle : triangles)
    for (const int i : triangle)
      if (i < 0 || static_cast<std::size_t>(i) >= vertices.size())
        throw DataError(fmt::format("a triangle has the vertex {} of {}", i, vertices.size()));
  for (const Eigen::Vector3d& p : vertices)
    if (!(p.cwiseAbs().maxCoeff() < kFarthestVertex))
      throw DataError(
          fmt::format("a vertex is not finite, or more than {:g} m away", kFarthestVertex));
  if (triangles.size() > kMostTriangles) {
    throw DataError(fmt::format("{} triangles violate triangles <= {}: simplify the mesh",
                                triangles.size(), kMostTriangles));
  }
  Weld(&vertices, &triangles);
  if (triangles.empty()) throw DataError("the mesh has no triangles");
  RequireClosed(vertices, triangles);
  TurnOutwards(vertices, &triangles);
  std::shared_ptr<PartMesh> mesh(new PartMesh);
  Eigen::AlignedBox3d bounds;
  for (const Triangle& triangle : triangles)
    for (const int i : triangle) bounds.extend(vertices[static_cast<std::size_t>(i)]);
  for (Eigen::Vector3d& p : vertices) p -= bounds.center();
  mesh->size_ = bounds.sizes();
  mesh->middle_ = bounds.center();
  mesh->vertices_ = std::move(vertices);
  mesh->triangles_ = std::move(triangles);
  FindFacets(mesh->vertices_, mesh->triangles_, &mesh->facets_, &mesh->facet_of_);
  double area = 0;
  mesh->centroid_.setZero();
  for (const Triangle& t : mesh->triangles_) {
    const auto at = [&](std::size_t k) { return mesh->vertices_[static_cast<std::size_t>(t[k])]; };
    const double own = (at(1) - at(0)).cross(at(2) - at(0)).norm() / 2;
    mesh->centroid_ += own / 3 * (at(0) + at(1) + at(2));
    area += own;
  }
  mesh->centroid_ /= area;
  mesh->scene_ = std::make_unique<Scene>(mesh->vertices_, mesh->triangles_);
  for (Facet& facet : mesh->facets_) {
    FindOpenCells(*mesh, &facet);
    facet.labelled = facet.labelled && facet.outline->open_area >= kLeastFacetArea;
  }
  PutLabelledFirst(&mesh->facets_, &mesh->facet_of_);
  return mesh;
}

std::shared_ptr<const PartMesh> PartMesh::Make(const std::vector<double>& coordinates,
                                               const std::vector<int>& indices) {
  if (coordinates.size() % 3 != 0 || indices.size() % 3 != 0) {
    throw DataError(fmt::format(
        "{} coordinates of vertices and {} indices of triangles are no multiples of three",
        coordinates.size(), indices.size()));
  }
  std::vector<Eigen::Vector3d> vertices;
  for (std::size_t i = 0; i < coordinates.size(); i += 3)
    vertices.emplace_back(coordinates.data() + i);
  std::vector<Triangle> triangles;
  for (std::size_t i = 0; i < indices.size(); i += 3)
    triangles.push_back({indices[i], indices[i + 1], indices[i + 2]});
  return Make(std::move(vertices), std::move(triangles));
}

Eigen::Vector3d PartMesh::NormalOf(int triangle) const {
  const Triangle& t = triangles_[static_cast<std::size_t>(triangle)];
  const auto at = [&](std::size_t k) { return vertices_[static_cast<std::size_t>(t[k])]; };
  return (at(1) - at(0)).cross(at(2) - at(0)).normalized();
}

std::optional<PartMesh::Hit> PartMesh::FirstHit(const Eigen::Vector3d& origin,
                                                const Eigen::Vector3d& direction) const {
  float t = 0;
  const int triangle = scene_->FirstHit(origin, direction, &t);
  if (triangle < 0) return std::nullopt;
  const Eigen::Vector3d normal = NormalOf(triangle);
  const double slope = normal.dot(direction);
  if (slope >= 0) return std::nullopt;  // it leaves
  const Eigen::Vector3d& corner =
      vertices_[static_cast<std::size_t>(triangles_[static_cast<std::size_t>(triangle)][0])];
  // The plane's own depth is exact, Embree's has 24 bits.
  const double exact = normal.dot(corner - origin) / slope;
  return Hit{std::abs(exact - t) < 1e-3 * std::abs(exact) ? exact : static_cast<double>(t),
             triangle};
}

PartMesh::Nearest PartMesh::NearestPoint(const Eigen::Vector3d& p,
                                         const std::function<bool(int)>& counts) const {
  struct Search {
    const PartMesh* mesh;
    const Eigen::Vector3d* p;
    const std::function<bool(int)>* counts;
    Nearest best;
  } search{this, &p, &counts, {std::numeric_limits<double>::infinity(), p, -1}};
  RTCPointQuery query{};
  query.x = static_cast<float>(p.x());
  query.y = static_cast<float>(p.y());
  query.z = static_cast<float>(p.z());
  query.radius = std::numeric_limits<float>::infinity();
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(
      scene_->scene, &query, &context,
      [](RTCPointQueryFunctionArguments* arguments) {
        auto& of = *static_cast<Search*>(arguments->userPtr);
        const auto triangle = static_cast<int>(arguments->primID);
        if (*of.counts && !(*of.counts)(triangle)) return false;
        const Triangle& t = of.mesh->triangles_[arguments->primID];
        const auto at = [&](std::size_t k) {
          return of.mesh->vertices_[static_cast<std::size_t>(t[k])];
        };
        const Eigen::Vector3d point = ClosestOn({at(0), at(1), at(2)}, *of.p);
        const double squared = (point - *of.p).squaredNorm();
        if (squared >= of.best.squared_distance) return false;
        of.best = {squared, point, triangle};
        // A little more than the distance, which is rounded.
        arguments->query->radius = static_cast<float>(std::sqrt(squared) * (1 + 1e-5) + 1e-7);
        return true;
      },
      &search);
  return search.best;
}

bool PartMesh::Contains(const Eigen::Vector3d& p) const {
  if ((p.cwiseAbs().array() > size_.array() / 2).any()) return false;
  // A direction that is parallel to no edge that somebody draws.
  return scene_->Leaves(p, {0.5773, 0.5317, 0.6197}) > 0;
}

}  // namespace volalign
