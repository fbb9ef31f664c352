#include "render/depth_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
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

void FindFacesInView(const SceneMesh& mesh, const Pose& structure_from_sensor,
                     const std::array<float, 4>& bounds, std::vector<FaceInView>* faces) {
  constexpr auto kNear = static_cast<float>(DepthRenderer::kNear);
  faces->clear();
  const Pose sensor_from_structure = structure_from_sensor.inverse();
  const Eigen::Matrix3f rotation = sensor_from_structure.linear().cast<float>();
  const Eigen::Vector3f translation = sensor_from_structure.translation().cast<float>();
  const Eigen::Vector3d eye = structure_from_sensor.translation();
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    const SceneFace& face = mesh.faces[i];
    const double h = face.offset - face.normal.dot(eye);  // sensor frame: n . p = h, n points away
    if (h > -1e-6) continue;
    FaceInView in_view;
    std::array<int, 5> outside{};
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3f p = rotation * face.corners[k] + translation;
      in_view.corners[k] = p;
      outside[0] += p.x() < bounds[0] * p.z();
      outside[1] += p.x() > bounds[1] * p.z();
      outside[2] += p.y() < bounds[2] * p.z();
      outside[3] += p.y() > bounds[3] * p.z();
      outside[4] += p.z() < kNear;
    }
    if (*std::max_element(outside.begin(), outside.end()) == 4) continue;
    const auto& c = in_view.corners;
    std::tie(in_view.low_z, in_view.high_z) = std::minmax({c[0].z(), c[1].z(), c[2].z(), c[3].z()});
    in_view.inverse = (sensor_from_structure.linear() * face.normal / h).cast<float>();
    in_view.id = static_cast<std::uint32_t>(face.label) << 16 | static_cast<std::uint32_t>(i + 1);
    faces->push_back(in_view);
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
