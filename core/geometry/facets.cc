#include "core/geometry/part_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "core/geometry/pose.h"

namespace volalign {

namespace {

const double kOneFacet = std::cos(2 * kDegree);  // of the normals' angle
constexpr double kOffPlane = 1e-3;               // m
/// Neighbours that turn by less (25 deg) are one curved surface, if neither is much wider.
const double kSmooth = std::cos(25 * kDegree);
constexpr double kMuchWider = 3;
/// Least part of a flat facet's border that is not smooth.
constexpr double kSharpShare = 0.5;
constexpr double kFacesDown = -0.5;  // y of a normal
const double kStraight = std::cos(1 * kDegree);

using Triangle = PartMesh::Triangle;
using Edge = std::pair<int, int>;

struct Region {
  std::vector<int> triangles;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  double area = 0;
  double width = 0;
};

/// A directed edge of a region's outline, and the region on its other side.
struct OuterEdge {
  int from, to, beyond;
};

/// Areas in steps of 1 mm^2. Those of shapes in whole or half millimetres are in the middle of a
/// step.
long AreaStep(double area) { return std::lround(1e6 * area + 0.2); }

class Merging {
 public:
  Merging(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& triangles)
      : vertices_(vertices), triangles_(triangles), region_of_(triangles.size(), -1) {
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      const Triangle& t = triangles[i];
      normals_.push_back((P(t[1]) - P(t[0])).cross(P(t[2]) - P(t[0])));
      for (std::size_t k = 0; k < 3; ++k)
        owners_[{t[k], t[(k + 1) % 3]}].push_back(static_cast<int>(i));
    }
    GrowRegions();
    for (std::size_t r = 0; r < regions_.size(); ++r) outer_.push_back(OuterEdges(r));
    for (std::size_t r = 0; r < regions_.size(); ++r) {
      double length = 0;
      for (const OuterEdge& a : outer_[r])
        for (const OuterEdge& b : outer_[r])
          length = std::max(length, (P(a.from) - P(b.from)).norm());
      regions_[r].width = length > 0 ? regions_[r].area / length : 0;
    }
  }

  void Collect(std::vector<Facet>* facets, std::vector<int>* facet_of) const {
    std::vector<std::size_t> order(regions_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    // Equal areas differ by rounding, which is another one in a file of the same mesh.
    const auto rank = [&](std::size_t r) {
      const auto& all = regions_[r].triangles;
      return std::pair(-AreaStep(regions_[r].area), *std::min_element(all.begin(), all.end()));
    };
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return rank(a) < rank(b); });
    facet_of->assign(triangles_.size(), -1);
    std::map<std::array<int, 3>, std::vector<int>> others;  // by the way that they face
    for (const std::size_t r : order) {
      const Region& region = regions_[r];
      if (!IsFlat(r) || region.area < kLeastFacetArea) {
        for (const int t : region.triangles) {
          const Eigen::Vector3d n = Normal(t);
          others[{static_cast<int>(std::lround(n.x())), static_cast<int>(std::lround(n.y())),
                  static_cast<int>(std::lround(n.z()))}]
              .push_back(t);
        }
        continue;
      }
      for (const int t : region.triangles)
        (*facet_of)[static_cast<std::size_t>(t)] = static_cast<int>(facets->size());
      facets->push_back(FacetOf(region, outer_[r]));
      facets->back().flat = true;
      facets->back().labelled = IsLabelled(r);
    }
    for (const auto& [way, members] : others) {
      Region region;
      region.triangles = members;
      for (const int t : members) {
        region.normal += normals_[static_cast<std::size_t>(t)];
        region.area += Area(t);
        (*facet_of)[static_cast<std::size_t>(t)] = static_cast<int>(facets->size());
      }
      if (!(region.normal.norm() > 0)) region.normal = Normal(members.front());
      region.normal.normalize();
      facets->push_back(FacetOf(region, {}));
    }
  }

 private:
  const Eigen::Vector3d& P(int i) const { return vertices_[static_cast<std::size_t>(i)]; }
  double Area(int t) const { return normals_[static_cast<std::size_t>(t)].norm() / 2; }
  Eigen::Vector3d Normal(int t) const { return normals_[static_cast<std::size_t>(t)].normalized(); }

  /// Grows regions from the largest triangles on.
  void GrowRegions() {
    std::vector<int> order(triangles_.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return AreaStep(Area(a)) > AreaStep(Area(b)); });
    for (const int seed : order) {
      if (region_of_[static_cast<std::size_t>(seed)] >= 0) continue;
      const int index = static_cast<int>(regions_.size());
      const Eigen::Vector3d normal = Normal(seed);
      const Eigen::Vector3d& origin = P(triangles_[static_cast<std::size_t>(seed)][0]);
      Region region;
      region.triangles = {seed};
      region_of_[static_cast<std::size_t>(seed)] = index;
      for (std::size_t next = 0; next < region.triangles.size(); ++next) {
        const Triangle& t = triangles_[static_cast<std::size_t>(region.triangles[next])];
        region.area += Area(region.triangles[next]);
        region.normal += normals_[static_cast<std::size_t>(region.triangles[next])];
        for (std::size_t k = 0; k < 3; ++k) {
          const auto found = owners_.find({t[(k + 1) % 3], t[k]});
          if (found == owners_.end()) continue;
          for (const int other : found->second) {
            int& of = region_of_[static_cast<std::size_t>(other)];
            // A sliver has no normal of its own.
            const bool faces_alike =
                Area(other) < kOffPlane * kOffPlane || Normal(other).dot(normal) > kOneFacet;
            if (of >= 0 || !faces_alike) continue;
            const Triangle& corners = triangles_[static_cast<std::size_t>(other)];
            if (std::any_of(corners.begin(), corners.end(), [&](int corner) {
                  return std::abs(normal.dot(P(corner) - origin)) > kOffPlane;
                }))
              continue;
            of = index;
            region.triangles.push_back(other);
          }
        }
      }
      region.normal.normalize();
      regions_.push_back(std::move(region));
    }
  }

  std::vector<OuterEdge> OuterEdges(std::size_t r) const {
    std::vector<OuterEdge> edges;
    for (const int index : regions_[r].triangles) {
      const Triangle& t = triangles_[static_cast<std::size_t>(index)];
      for (std::size_t k = 0; k < 3; ++k) {
        const int from = t[k], to = t[(k + 1) % 3];
        const auto found = owners_.find({to, from});
        int beyond = -1;
        bool inside = false;
        for (const int other : found == owners_.end() ? std::vector<int>{} : found->second) {
          const int of = region_of_[static_cast<std::size_t>(other)];
          inside = inside || of == static_cast<int>(r);
          beyond = of;
        }
        if (!inside) edges.push_back({from, to, beyond});
      }
    }
    return edges;
  }

  /// Is a region a part of no curved surface?
  bool IsFlat(std::size_t r) const {
    double sharp = 0, all = 0;
    for (const OuterEdge& edge : outer_[r]) {
      const double length = (P(edge.to) - P(edge.from)).norm();
      all += length;
      if (edge.beyond < 0) continue;
      const Region& beyond = regions_[static_cast<std::size_t>(edge.beyond)];
      if (beyond.normal.dot(regions_[r].normal) < kSmooth ||
          kMuchWider * beyond.width < regions_[r].width)
        sharp += length;
    }
    return sharp >= kSharpShare * all;
  }
  bool IsLabelled(std::size_t r) const {
    const Region& region = regions_[r];
    return region.area >= kLeastFacetArea && region.width >= kLeastFacetWidth &&
           region.normal.y() > kFacesDown && IsFlat(r);
  }

  /// The edges of an outline, joined where they go straight on.
  std::vector<std::pair<int, int>> Joined(const std::vector<OuterEdge>& edges) const {
    std::multimap<int, std::size_t> from;
    for (std::size_t i = 0; i < edges.size(); ++i) from.emplace(edges[i].from, i);
    std::vector<char> used(edges.size(), 0);
    const auto next_of = [&](std::size_t i) -> std::optional<std::size_t> {
      const auto [first, last] = from.equal_range(edges[i].to);
      for (auto it = first; it != last; ++it)
        if (!used[it->second]) return it->second;
      return std::nullopt;
    };
    std::vector<std::pair<int, int>> joined;
    for (std::size_t start = 0; start < edges.size(); ++start) {
      if (used[start]) continue;
      std::vector<std::pair<int, int>> loop;
      for (std::optional<std::size_t> at = start; at; at = next_of(*at)) {
        used[*at] = 1;
        const OuterEdge& edge = edges[*at];
        if (!loop.empty() && GoesOn(loop.back(), {edge.from, edge.to})) {
          loop.back().second = edge.to;
        } else {
          loop.emplace_back(edge.from, edge.to);
        }
      }
      if (loop.size() > 1 && GoesOn(loop.back(), loop.front())) {
        loop.front().first = loop.back().first;
        loop.pop_back();
      }
      joined.insert(joined.end(), loop.begin(), loop.end());
    }
    return joined;
  }
  bool GoesOn(const std::pair<int, int>& a, const std::pair<int, int>& b) const {
    return a.second == b.first &&
           (P(a.second) - P(a.first)).normalized().dot((P(b.second) - P(b.first)).normalized()) >
               kStraight;
  }

  Facet FacetOf(const Region& region, const std::vector<OuterEdge>& outer) const {
    const std::vector<std::pair<int, int>> borders = Joined(outer);
    Facet facet;
    facet.normal = region.normal;
    // Along the longest border.
    Eigen::Vector3d along = facet.normal.unitOrthogonal();
    double longest = 0;
    for (const auto& [a, b] : borders) {
      if ((P(b) - P(a)).norm() <= longest) continue;
      longest = (P(b) - P(a)).norm();
      along = P(b) - P(a);
    }
    facet.axis_u = (along - along.dot(facet.normal) * facet.normal).normalized();
    facet.axis_v = facet.normal.cross(facet.axis_u);
    const auto flat = [&](const Eigen::Vector3d& p) {
      return Eigen::Vector2d(facet.axis_u.dot(p), facet.axis_v.dot(p));
    };
    Eigen::AlignedBox2d bounds;
    double offset = 0;
    for (const int t : region.triangles) {
      for (const int i : triangles_[static_cast<std::size_t>(t)]) {
        bounds.extend(flat(P(i)));
        offset += Area(t) / region.area / 3 * facet.normal.dot(P(i));
      }
    }
    const Eigen::Vector2d middle = bounds.center();
    facet.centre = middle.x() * facet.axis_u + middle.y() * facet.axis_v + offset * facet.normal;
    facet.half_u = bounds.sizes().x() / 2;
    facet.half_v = bounds.sizes().y() / 2;
    auto outline = std::make_shared<Outline>();
    for (const int t : region.triangles) {
      const Triangle& corners = triangles_[static_cast<std::size_t>(t)];
      std::array<Eigen::Vector2d, 3> piece;
      for (std::size_t k = 0; k < 3; ++k) piece[k] = flat(P(corners[k])) - middle;
      const Eigen::Vector2d ab = piece[1] - piece[0], ac = piece[2] - piece[0];
      const double area = std::abs(ab.x() * ac.y() - ab.y() * ac.x()) / 2;
      outline->area += area;
      outline->centroid += area / 3 * (piece[0] + piece[1] + piece[2]);
      outline->triangles.push_back(piece);
    }
    if (outline->area > 0) outline->centroid /= outline->area;
    for (const auto& [a, b] : borders) {
      Outline::Border border{flat(P(a)) - middle, flat(P(b)) - middle, Eigen::Vector2d::Zero()};
      const Eigen::Vector2d d = (border.to - border.from).normalized();
      border.outward = {d.y(), -d.x()};
      outline->borders.push_back(border);
    }
    facet.outline = std::move(outline);
    return facet;
  }

  const std::vector<Eigen::Vector3d>& vertices_;
  const std::vector<Triangle>& triangles_;
  std::vector<Eigen::Vector3d> normals_;     // twice the area long
  std::map<Edge, std::vector<int>> owners_;  // triangles by directed edge
  std::vector<int> region_of_;
  std::vector<Region> regions_;
  std::vector<std::vector<OuterEdge>> outer_;
};

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

bool Outline::Contains(const Eigen::Vector2d& p) const {
  if (!borders.empty()) {
    bool inside = false;  // an even number of borders lies beyond
    for (const Border& border : borders) {
      const Eigen::Vector2d &a = border.from, &b = border.to;
      if ((a.y() > p.y()) != (b.y() > p.y()) &&
          p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
        inside = !inside;
    }
    return inside;
  }
  return std::any_of(triangles.begin(), triangles.end(), [&](const auto& t) {
    const double a = Cross(t[1] - t[0], p - t[0]), b = Cross(t[2] - t[1], p - t[1]),
                 c = Cross(t[0] - t[2], p - t[2]);
    return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
  });
}

Eigen::Vector2d Outline::ClosestPoint(const Eigen::Vector2d& p) const {
  if (Contains(p)) return p;
  Eigen::Vector2d closest = Eigen::Vector2d::Zero();
  double least = std::numeric_limits<double>::infinity();
  const auto visit = [&](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    const Eigen::Vector2d d = b - a;
    const double along = std::clamp(d.dot(p - a) / std::max(d.squaredNorm(), 1e-18), 0.0, 1.0);
    const Eigen::Vector2d q = a + along * d;
    if ((q - p).squaredNorm() >= least) return;
    least = (q - p).squaredNorm();
    closest = q;
  };
  if (borders.empty()) {
    for (const auto& t : triangles)
      for (std::size_t k = 0; k < 3; ++k) visit(t[k], t[(k + 1) % 3]);
  }
  for (const Border& border : borders) visit(border.from, border.to);
  return closest;
}

void FindFacets(const std::vector<Eigen::Vector3d>& vertices,
                const std::vector<PartMesh::Triangle>& triangles, std::vector<Facet>* facets,
                std::vector<int>* facet_of) {
  Merging(vertices, triangles).Collect(facets, facet_of);
}

}  // namespace volalign
