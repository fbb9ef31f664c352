#include "render/tiles/tile_renderer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "core/geometry/lens.h"
#include "render/recent_lenses.h"

namespace volalign {

using tiles::kTileHeight;
using tiles::kTilePixels;
using tiles::kTileWidth;
using tiles::Linear;
using tiles::TileFace;

namespace {

constexpr int kMostSize = 16384;  // px
/// Faces are extended by this angle beyond their edges: 1 um at 1 m. So no ray passes between two
/// faces whose common corners differ by rounding.
constexpr float kOverlap = 1e-6F;  // rad
constexpr float kInfinite = std::numeric_limits<float>::infinity();

Linear ToLinear(const Eigen::Vector3f& f) { return {f.x(), f.y(), f.z()}; }

TileFace MakeFace(const FaceInView& in_view) {
  const auto& [corners, low_z, high_z, inverse, id] = in_view;
  constexpr auto kNear = static_cast<float>(DepthRenderer::kNear);
  constexpr float kRounding = 1e-5F;  // m, of the corners themselves
  TileFace face{};
  face.inverse = ToLinear(inverse);
  face.id = id;
  face.low_y = kInfinite;
  face.high_y = -kInfinite;
  for (const Eigen::Vector3f& p : corners) {
    face.low_y = std::min(face.low_y, p.y() / p.z());
    face.high_y = std::max(face.high_y, p.y() / p.z());
  }
  face.least = 1 / (high_z + kRounding);
  face.most = 1 / std::max(low_z - kRounding, kNear);
  face.low_y -= kOverlap;
  face.high_y += kOverlap;
  face.num_edges = 4;
  // The order of the corners around n / h, which points away from the eye. Two adjacent corners may
  // be equal, but not the ends of a diagonal.
  const float order =
      (corners[2] - corners[0]).cross(corners[3] - corners[1]).dot(inverse) < 0 ? -1 : 1;
  for (std::size_t k = 0; k < 4; ++k) {
    Eigen::Vector3f edge = order * corners[k].cross(corners[(k + 1) % 4]);
    edge.z() += kOverlap * edge.norm();
    face.edges[k] = ToLinear(edge);
  }
  if (low_z < kNear) {
    face.num_edges = 6;
    face.edges[4] = face.inverse;
    face.edges[5] = {-inverse.x(), -inverse.y(), 1 / kNear - inverse.z()};
    face.low_y = -kInfinite;
    face.high_y = kInfinite;
  }
  return face;
}

/// Index of an element in rows of `width` elements.
std::size_t Index(int row, int width, int column) {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
         static_cast<std::size_t>(column);
}

/// The rays of all tiles, row by row of tiles, and the ranges of each tile's rays.
struct Rays {
  std::shared_ptr<const RayTable> table;
  int columns, rows;  ///< tiles
  int padded;         ///< tiles in a row of `ranges`, a multiple of 16
  bool is_pinhole;    ///< all rows of a tile share `x`, and all of its columns have one `y`
  std::vector<float> x, y;
  std::vector<float> low_x, high_x, low_y, high_y;  ///< [rows, padded]; NaN: no ray
  std::array<float, 4> bounds;                      ///< of all rays, see FindFacesInView
  std::vector<float> row_low_y, row_high_y;         ///< of a row of tiles

  tiles::TileRays Tile(int column, int row) const {
    if (is_pinhole) {
      return {&x[static_cast<std::size_t>(column) * kTileWidth],
              &y[static_cast<std::size_t>(row) * kTilePixels], 0, kTileWidth};
    }
    const std::size_t first = Index(row, columns, column) * kTilePixels;
    return {&x[first], &y[first], kTileWidth, kTileWidth};
  }
};

Rays CollectRays(const Intrinsics& intrinsics) {
  RayTable table = ComputeRays(intrinsics);
  const int width = table.width, height = table.height;
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  Rays rays;
  rays.columns = (width + kTileWidth - 1) / kTileWidth;
  rays.rows = (height + kTileHeight - 1) / kTileHeight;
  rays.padded = (rays.columns + 15) / 16 * 16;
  rays.is_pinhole = intrinsics.distortion.empty();
  const std::size_t ranges = Index(rays.rows, rays.padded, 0);
  rays.low_x.assign(ranges, kNone);
  rays.high_x = rays.low_y = rays.high_y = rays.low_x;
  rays.row_low_y.assign(static_cast<std::size_t>(rays.rows), kInfinite);
  rays.row_high_y.assign(static_cast<std::size_t>(rays.rows), -kInfinite);
  Eigen::Array2f low_all = Eigen::Array2f::Constant(kInfinite), high_all = -low_all;
  for (int row = 0; row < rays.rows; ++row) {
    for (int column = 0; column < rays.columns; ++column) {
      Eigen::Array2f low = Eigen::Array2f::Constant(kInfinite), high = -low;
      for (int i = 0; i < kTilePixels; ++i) {
        // Beyond the picture, tiles repeat its last pixels.
        const int u = std::min(column * kTileWidth + i % kTileWidth, width - 1);
        const int v = std::min(row * kTileHeight + i / kTileWidth, height - 1);
        const Eigen::Vector2f& ray = table.at(u, v);
        if (!rays.is_pinhole || (row == 0 && i < kTileWidth)) rays.x.push_back(ray.x());
        if (!rays.is_pinhole || column == 0) rays.y.push_back(ray.y());
        if (!ray.allFinite()) continue;
        low = low.min(ray.array());
        high = high.max(ray.array());
      }
      if (low.x() > high.x()) continue;  // no ray at all
      const std::size_t tile = Index(row, rays.padded, column);
      rays.low_x[tile] = low.x();
      rays.high_x[tile] = high.x();
      rays.low_y[tile] = low.y();
      rays.high_y[tile] = high.y();
      float& row_low = rays.row_low_y[static_cast<std::size_t>(row)];
      float& row_high = rays.row_high_y[static_cast<std::size_t>(row)];
      row_low = std::min(row_low, low.y());
      row_high = std::max(row_high, high.y());
      low_all = low_all.min(low);
      high_all = high_all.max(high);
    }
  }
  rays.bounds[0] = low_all.x();
  rays.bounds[1] = high_all.x();
  rays.bounds[2] = low_all.y();
  rays.bounds[3] = high_all.y();
  rays.table = ViewRays(std::move(table));
  return rays;
}

/// A face that a tile may see.
struct Candidate {
  std::uint32_t face;     ///< index into faces_
  std::int32_t crossing;  ///< of TileKernels::cover
  float nearest;
};

class TileRenderer : public DepthRenderer {
 public:
  explicit TileRenderer(const tiles::TileKernels& kernels) : kernels_(kernels) {}

  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override {
    RequireDrawable(mesh, intrinsics.width, intrinsics.height, kMostSize);
    const Rays& rays = rays_.Get(intrinsics, CollectRays);
    FitImages(intrinsics, view);
    view->rays = rays.table;
    CollectFaces(mesh, rays, structure_from_sensor);
    const auto columns = static_cast<std::size_t>(rays.columns);
    candidates_.resize(columns * faces_.size());
    counts_.resize(columns);
    nearest_.resize(static_cast<std::size_t>(rays.padded));
    crossing_.resize(nearest_.size());
    std::array<float, kTilePixels> inverse;
    std::array<std::uint32_t, kTilePixels> ids;
    for (int row = 0; row < rays.rows; ++row) {
      FindCandidates(rays, row);
      const int v = row * kTileHeight;
      for (int column = 0; column < rays.columns; ++column) {
        inverse.fill(0);
        ids.fill(0);
        float covered = 0;  // the least 1 / z of the tile's pixels
        const auto c = static_cast<std::size_t>(column);
        for (std::size_t k = 0; k < counts_[c]; ++k) {
          const Candidate& candidate = candidates_[c * faces_.size() + k];
          if (candidate.nearest <= covered) continue;
          covered = kernels_.paint(faces_[candidate.face], candidate.crossing,
                                   rays.Tile(column, row), inverse.data(), ids.data());
        }
        const int u = column * kTileWidth;
        kernels_.finish(inverse.data(), ids.data(),
                        {&view->depth(u, v), &view->labels(u, v), &view->faces(u, v),
                         intrinsics.width, std::min(kTileWidth, intrinsics.width - u),
                         std::min(kTileHeight, intrinsics.height - v)});
      }
    }
  }

 private:
  void CollectFaces(const SceneMesh& mesh, const Rays& rays, const Pose& structure_from_sensor) {
    FindFacesInView(mesh, structure_from_sensor, rays.bounds, &in_view_);
    faces_.clear();
    for (const FaceInView& face : in_view_) faces_.push_back(MakeFace(face));
    std::sort(faces_.begin(), faces_.end(), [](const TileFace& a, const TileFace& b) {
      return a.most != b.most ? a.most > b.most : (a.id & 0xFFFFU) < (b.id & 0xFFFFU);
    });
  }

  /// Finds the faces that each tile of a row may see.
  void FindCandidates(const Rays& rays, int row) {
    const auto r = static_cast<std::size_t>(row);
    const std::size_t first = r * static_cast<std::size_t>(rays.padded);
    const tiles::TileRanges ranges = {&rays.low_x[first], &rays.high_x[first], &rays.low_y[first],
                                      &rays.high_y[first]};
    const auto columns = static_cast<std::size_t>(rays.columns);
    std::fill(counts_.begin(), counts_.end(), 0U);
    for (std::uint32_t f = 0; f < faces_.size(); ++f) {
      if (faces_[f].low_y > rays.row_high_y[r] || faces_[f].high_y < rays.row_low_y[r]) continue;
      kernels_.cover(faces_[f], ranges, rays.padded, nearest_.data(), crossing_.data());
      for (std::size_t c = 0; c < columns; ++c) {
        if (nearest_[c] > 0) {
          candidates_[c * faces_.size() + counts_[c]++] = {f, crossing_[c], nearest_[c]};
        }
      }
    }
  }

  const tiles::TileKernels kernels_;
  RecentLenses<Rays> rays_;
  std::vector<FaceInView> in_view_;
  std::vector<TileFace> faces_;        // from the nearest on
  std::vector<Candidate> candidates_;  // [columns, faces]
  std::vector<std::uint32_t> counts_;  // of each column of tiles
  std::vector<float> nearest_;
  std::vector<std::int32_t> crossing_;
};

}  // namespace

RendererFactory TileRenderers(const tiles::TileKernels& kernels) {
  return [kernels] { return std::make_unique<TileRenderer>(kernels); };
}

}  // namespace volalign
