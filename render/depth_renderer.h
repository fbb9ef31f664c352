#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "render/scene_mesh.h"

namespace volalign {

/// The view of a mesh without noise. All images have the intrinsics' size.
struct RenderedView {
  DepthImage depth;   ///< m along the optical axis, 0 without a face
  LabelImage labels;  ///< 0 for background
  Image16 faces;      ///< 1 + index into SceneMesh::faces, 0 without a face
  /// Rays of every pixel. A ray is zero where the lens has folded over, and no face is seen there.
  /// Pictures of the same intrinsics share one table.
  std::shared_ptr<const RayTable> rays;
};

/// Draws depth, labels and face indices.
class DepthRenderer {
 public:
  virtual ~DepthRenderer() = default;

  /// Faces nearer than kNear are clipped. `view` keeps its memory between calls. Throws Error for
  /// intrinsics without a size, or larger than the renderer's limit, and for more than 65535 faces.
  /// Throws DataError for a lens that cannot be inverted.
  virtual void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
                      const Pose& structure_from_sensor, RenderedView* view) = 0;

  static constexpr double kNear = 0.02;  ///< m
};

/// Makes a renderer for the calling thread, which must also destroy it.
using RendererFactory = std::function<std::unique_ptr<DepthRenderer>()>;

/// Throws Error for a picture without a size or larger than `most_size`, and for more faces than 16
/// bits can number.
void RequireDrawable(const SceneMesh& mesh, int width, int height, int most_size);

/// A face in the sensor's frame, m.
struct FaceInView {
  std::array<Eigen::Vector3f, 4> corners;
  float low_z, high_z;      ///< of the corners
  Eigen::Vector3f inverse;  ///< 1 / z = inverse . (X, Y, 1) where the ray (X, Y, 1) meets its plane
  std::uint32_t id;         ///< label << 16 | 1 + index in SceneMesh::faces
};

/// The faces that are seen from their front, in their order. Faces that are completely nearer than
/// DepthRenderer::kNear, or beyond one of the `bounds` of the rays (low X, high X, low Y, high Y),
/// are left out. `faces` keeps its memory.
void FindFacesInView(const SceneMesh& mesh, const Pose& structure_from_sensor,
                     const std::array<float, 4>& bounds, std::vector<FaceInView>* faces);

/// Gives the images the intrinsics' size, if they have another one.
void FitImages(const Intrinsics& intrinsics, RenderedView* view);

/// ComputeRays' table for a view, with zero instead of NaN.
std::shared_ptr<const RayTable> ViewRays(RayTable rays);

}  // namespace volalign
