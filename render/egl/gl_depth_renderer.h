#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "render/depth_renderer.h"
#include "render/egl/egl_context.h"
#include "render/lens_picture.h"
#include "render/recent_lenses.h"
#include "render/scene_mesh.h"

namespace volalign {

/// Draws the face that each pixel shows. Owns GL objects: needs a current OpenGL 4.5 context
/// (EglContext) from construction to destruction, always the same one.
///
/// Depth does not depend on the rasteriser's interpolation. Every face has its plane n . p = h in
/// the sensor frame. The pixel's ray (x, y, 1) meets it at the depth z = 1 / ((n / h) . (x, y, 1)).
/// This is exact to float rounding, also with a lens (LensPicture).
class GlDepthRenderer : public DepthRenderer {
 public:
  GlDepthRenderer();
  ~GlDepthRenderer() override;
  GlDepthRenderer(const GlDepthRenderer&) = delete;
  GlDepthRenderer& operator=(const GlDepthRenderer&) = delete;

  /// The largest size is that of GL; with a lens, it holds for the lens's whole field of view.
  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override;

 private:
  void Resize(int width, int height);
  void CollectVertices(const SceneMesh& mesh, const Intrinsics& intrinsics,
                       const Pose& structure_from_sensor);
  void DrawVertices();
  /// Fills ids_ with FaceCorner::id of a pinhole picture.
  void DrawIds(const SceneMesh& mesh, const Intrinsics& pinhole, const Pose& structure_from_sensor);

  std::vector<FaceInView> in_view_;
  std::vector<FaceCorner> vertices_;
  std::vector<std::uint32_t> first_vertex_;  // of each face of the mesh that is drawn
  RecentLenses<LensPicture> pictures_;
  unsigned program_ = 0;
  unsigned vertex_array_ = 0;
  unsigned vertex_buffer_ = 0;
  unsigned index_buffer_ = 0;
  std::size_t indexed_faces_ = 0;
  unsigned framebuffer_ = 0;
  unsigned id_texture_ = 0;
  unsigned z_buffer_ = 0;
  int projection_location_ = -1;
  int width_ = 0;
  int height_ = 0;
  int max_size_ = 0;
  std::vector<std::uint32_t> ids_;
};

/// Renderers, each with its own context.
RendererFactory GlRenderers(const EglContextOptions& options = {});

}  // namespace volalign
