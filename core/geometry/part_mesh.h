#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace volalign {

/// Labelled facets of a mesh are at least so large and so wide. The width is the area divided by
/// the length.
inline constexpr double kLeastFacetArea = 5e-3, kLeastFacetWidth = 0.03;  // m^2, m
/// Parts cover each other if their gap, m, is smaller.
inline constexpr double kTouching = 1e-3;
/// Middles of the cells of a grid over a rectangle about the origin, m.
std::vector<Eigen::Vector2d> GridOver(double half_u, double half_v);
/// Most triangles of a mesh.
inline constexpr std::size_t kMostTriangles = 50000;

/// The form of a side, in the two axes of its plane, m. The origin is the middle of the rectangle
/// around it.
struct Outline {
  struct Border {
    Eigen::Vector2d from, to;
    Eigen::Vector2d outward;  ///< unit
  };
  std::vector<std::array<Eigen::Vector2d, 3>> triangles;
  std::vector<Border> borders;
  double area = 0;
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  /// Middles of the cells of a grid, of those that no solid of the same mesh covers; the area that
  /// they are, and its centre.
  std::vector<Eigen::Vector2d> open_cells;
  double open_area = 0;
  Eigen::Vector2d open_centroid = Eigen::Vector2d::Zero();

  bool Contains(const Eigen::Vector2d& p) const;
  Eigen::Vector2d ClosestPoint(const Eigen::Vector2d& p) const;
};

/// A facet of a mesh: neighbouring triangles whose normals differ by at most 2 degrees, and which
/// lie within 1 mm of one plane. Or all triangles of curved or small surface that face nearly the
/// same way.
struct Facet {
  bool flat = false;      ///< of one plane
  bool labelled = false;  ///< flat, open, large and wide enough, and not facing down
  Eigen::Vector3d centre, normal, axis_u, axis_v;  ///< see Side; the mesh's frame
  double half_u = 0, half_v = 0;
  std::shared_ptr<Outline> outline;
};

/// The surface of a rigid part that is no box. Immutable. Several threads may use it at once.
class PartMesh {
 public:
  using Triangle = std::array<int, 3>;  ///< of indices, anticlockwise as seen from outside

  /// Vertices that are nearer than 10 um become one. Throws DataError for more than kMostTriangles,
  /// and for a surface that is not closed or encloses no volume.
  static std::shared_ptr<const PartMesh> Make(std::vector<Eigen::Vector3d> vertices,
                                              std::vector<Triangle> triangles);
  /// The same from three coordinates for each vertex, and three indices for each triangle.
  static std::shared_ptr<const PartMesh> Make(const std::vector<double>& coordinates,
                                              const std::vector<int>& indices);
  ~PartMesh();
  PartMesh(const PartMesh&) = delete;
  PartMesh& operator=(const PartMesh&) = delete;

  const std::vector<Eigen::Vector3d>& vertices() const { return vertices_; }
  const std::vector<Triangle>& triangles() const { return triangles_; }
  /// The box along the axes around it: its size, and where its middle was in the vertices given. It
  /// is the origin of vertices().
  const Eigen::Vector3d& size() const { return size_; }
  const Eigen::Vector3d& middle() const { return middle_; }
  /// Middle of its surface.
  const Eigen::Vector3d& centroid() const { return centroid_; }
  /// The labelled ones, the largest first, then the others.
  const std::vector<Facet>& facets() const { return facets_; }
  int FacetOf(int triangle) const { return facet_of_[static_cast<std::size_t>(triangle)]; }
  Eigen::Vector3d NormalOf(int triangle) const;

  struct Hit {
    double t = 0;
    int triangle = -1;
  };
  /// Where the ray origin + t * direction, t > 0, enters the surface first. Nothing for an origin
  /// inside.
  std::optional<Hit> FirstHit(const Eigen::Vector3d& origin,
                              const Eigen::Vector3d& direction) const;
  struct Nearest {
    double squared_distance = 0;
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    int triangle = -1;
  };
  /// The nearest point of the surface; only of the triangles for which `counts` is true, if it is
  /// given. `triangle` is -1 if there is none.
  Nearest NearestPoint(const Eigen::Vector3d& p,
                       const std::function<bool(int)>& counts = nullptr) const;
  bool Contains(const Eigen::Vector3d& p) const;

 private:
  PartMesh() = default;
  std::vector<Eigen::Vector3d> vertices_;
  std::vector<Triangle> triangles_;
  Eigen::Vector3d size_, middle_, centroid_;
  std::vector<Facet> facets_;
  std::vector<int> facet_of_;  // triangle
  struct Scene;
  std::unique_ptr<Scene> scene_;
};

/// Merges a closed surface's triangles into facets. `facet_of`: of each triangle.
void FindFacets(const std::vector<Eigen::Vector3d>& vertices,
                const std::vector<PartMesh::Triangle>& triangles, std::vector<Facet>* facets,
                std::vector<int>* facet_of);

}  // namespace volalign
