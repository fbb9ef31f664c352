#pragma once

#include <cstdint>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "core/pose.h"
#include "render/lens_picture.h"
#include "render/scene_mesh.h"

namespace volalign {

/// What a sensor without noise would see of a mesh. All images have the intrinsics' size.
struct RenderedView {
  DepthImage depth;   ///< m along the optical axis, 0 where nothing is
  LabelImage labels;  ///< 0 for background
  Image16 faces;      ///< 1 + index into SceneMesh::faces, 0 where nothing is
  /// Of every pixel; zero where a lens has folded over, where nothing is seen either.
  RayTable rays;
};

/// Draws depth, labels and face indices in one pass. Owns GL objects: needs a current OpenGL 4.5
/// context (EglContext) from construction to destruction, always the same one.
///
/// Depth does not depend on how the rasteriser interpolates: every face carries its plane n . p = h
/// in the sensor frame, and a pixel's depth is z = 1 / ((n / h) . ((u - cx) / fx, (v - cy) / fy,
/// 1)), exact to float rounding. So it is with a lens, by the ray of the pixel (LensPicture).
class DepthRenderer {
 public:
  DepthRenderer();
  ~DepthRenderer();
  DepthRenderer(const DepthRenderer&) = delete;
  DepthRenderer& operator=(const DepthRenderer&) = delete;

  /// Faces nearer than kNear are clipped. `view` keeps its memory from call to call. Throws Error
  /// for intrinsics without a size, or larger than the GL's limit (with a lens: its whole field of
  /// view), and for more than 65535 faces; DataError for a lens that cannot be inverted.
  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view);

  static constexpr double kNear = 0.02;  ///< m

 private:
  void Resize(int width, int height);
  void CollectVertices(const SceneMesh& mesh, const Intrinsics& intrinsics,
                       const Pose& structure_from_sensor);
  void ClearTargets();
  void SetCamera(const Intrinsics& intrinsics);
  void DrawVertices();
  void DrawPinhole(const SceneMesh& mesh, const Intrinsics& intrinsics,
                   const Pose& structure_from_sensor);
  void ReadIds();
  void ReadBack(RenderedView* view);
  const LensPicture& PictureOf(const Intrinsics& lens);

  std::vector<FaceCorner> vertices_;
  std::vector<std::uint32_t> first_vertex_;  // of each face of the mesh that is drawn
  std::vector<LensPicture> pictures_;        // of the lenses drawn last
  unsigned program_ = 0;
  unsigned vertex_array_ = 0;
  unsigned vertex_buffer_ = 0;
  unsigned index_buffer_ = 0;
  std::size_t indexed_faces_ = 0;
  unsigned framebuffer_ = 0;
  unsigned depth_texture_ = 0;
  unsigned id_texture_ = 0;
  unsigned z_buffer_ = 0;
  int camera_location_ = -1;
  int projection_location_ = -1;
  int width_ = 0;
  int height_ = 0;
  int max_size_ = 0;
  std::vector<std::uint32_t> ids_;
};

}  // namespace volalign
