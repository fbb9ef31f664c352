#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "render/depth_renderer.h"
#include "render/recent_lenses.h"
#include "render/tiles/tile_kernels.h"

namespace volalign {

/// Draws on the processor, without a driver and without a lock: as many renderers at once as there
/// are threads.
///
/// The picture is cut into tiles of 16x8 pixels. In homogeneous coordinates (Olano and Greer,
/// "Triangle scan conversion using 2D homogeneous coordinates", 1997), whether a pixel's ray passes
/// through a face, and 1 / depth where it does, are linear functions of the ray, so that no face is
/// clipped or projected, and any lens is as exact as a pinhole: a ray of its own for each pixel.
/// Over the rectangle of a tile's rays, the functions' extremes say which faces a tile may see and
/// which edges cut it. A tile draws its faces from the nearest on and leaves out those behind what
/// covers it already.
///
/// Depth is where the ray meets the face's plane, exact to float rounding. The picture is the same
/// to the last bit whatever instructions the processor has, and whichever thread draws.
class TileRenderer : public DepthRenderer {
 public:
  /// With the best instructions that this processor has; tests name others.
  TileRenderer();
  explicit TileRenderer(const tiles::TileKernels& kernels) : kernels_(kernels) {}

  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override;

  /// For people.
  std::string Describe() const;

 private:
  /// The rays of all tiles, row by row of tiles, and the ranges of each tile's.
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
    std::int32_t crossing;  ///< as TileKernels::cover gives it
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
