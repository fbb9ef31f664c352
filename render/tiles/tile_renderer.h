#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "render/depth_renderer.h"
#include "render/recent_lenses.h"
#include "render/tiles/tile_kernels.h"

namespace volalign {

/// Draws on the processor, without a driver and without a lock: one renderer per thread may run.
///
/// The picture is divided into tiles of 16x8 pixels. In homogeneous coordinates, two functions of a
/// pixel's ray are linear: whether it passes through a face, and 1 / depth where it does. Source:
/// Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997. So no face
/// is clipped or projected. A lens is as exact as a pinhole, as each pixel has its own ray. The
/// functions' extremes over the rectangle of a tile's rays give the faces that the tile may see and
/// the edges that cut it. A tile draws its faces from the nearest on and skips those behind its
/// cover.
///
/// Depth is where the ray meets the face's plane, exact to float rounding. The picture is the same
/// to the last bit for all instruction sets and threads.
class TileRenderer : public DepthRenderer {
 public:
  /// With the best instructions of this processor; tests name others.
  TileRenderer();
  explicit TileRenderer(const tiles::TileKernels& kernels) : kernels_(kernels) {}

  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override;

  /// A description for people.
  std::string Describe() const;

 private:
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
    tiles::TileRays Tile(int column, int row) const;
  };
  /// A face that a tile may see.
  struct Candidate {
    std::uint32_t face;     ///< index into faces_
    std::int32_t crossing;  ///< of TileKernels::cover
    float nearest;
  };

  static Rays CollectRays(const Intrinsics& intrinsics);
  void CollectFaces(const SceneMesh& mesh, const Rays& rays, const Pose& structure_from_sensor);
  void FindCandidates(const Rays& rays, int row);

  tiles::TileKernels kernels_;
  RecentLenses<Rays> rays_;
  std::vector<FaceInView> in_view_;
  std::vector<tiles::TileFace> faces_;  // from the nearest on
  std::vector<Candidate> candidates_;   // [columns, faces]
  std::vector<std::uint32_t> counts_;   // of each column of tiles
  std::vector<float> nearest_;
  std::vector<std::int32_t> crossing_;
};

RendererFactory TileRenderers();

}  // namespace volalign
