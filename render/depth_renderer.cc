#include "render/depth_renderer.h"

#include <fmt/format.h>

#include <utility>

#include "core/base/error.h"

namespace volalign {

void RequireDrawable(const SceneMesh& mesh, int width, int height, int most_size) {
  constexpr std::size_t kMostFaces = 65535;
  if (width <= 0 || height <= 0 || width > most_size || height > most_size) {
    throw Error(fmt::format("DepthRenderer: image size {}x{} violates 1 <= size <= {}", width,
                            height, most_size));
  }
  if (mesh.faces.size() > kMostFaces) {
    throw Error(fmt::format("DepthRenderer: {} faces violate faces <= {}; draw fewer objects",
                            mesh.faces.size(), kMostFaces));
  }
}

void FitImages(const Intrinsics& intrinsics, RenderedView* view) {
  if (view->depth.width() == intrinsics.width && view->depth.height() == intrinsics.height &&
      view->faces.size() == view->depth.size() && view->labels.size() == view->depth.size()) {
    return;
  }
  view->depth = DepthImage(intrinsics.width, intrinsics.height);
  view->labels = LabelImage(intrinsics.width, intrinsics.height);
  view->faces = Image16(intrinsics.width, intrinsics.height);
}

std::shared_ptr<const RayTable> ViewRays(RayTable rays) {
  for (Eigen::Vector2f& ray : rays.rays) {
    if (!ray.allFinite()) ray.setZero();
  }
  return std::make_shared<const RayTable>(std::move(rays));
}

}  // namespace volalign
