#include "render/lens_picture.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/geometry/lens.h"

namespace volalign {
namespace {

/// Pixels of the pinhole picture per pixel in the middle of the image, along an axis.
constexpr double kOversampling = 2;
/// Pixels of the pinhole picture beyond the outermost rays.
constexpr double kRim = 2;

struct Hit {
  float depth = 0;
  std::uint32_t number = 0;  ///< 1 + the face's index; 0 without a face
};

/// Does the ray (x, y, 1) pass through the face, a convex polygon that is at least partly in front
/// of the camera? The ray has to be on the inner side of the planes through the eye and each edge.
bool Meets(const FaceInView& face, const Eigen::Vector3f& ray) {
  const auto& corners = face.corners;
  if (!(face.inverse.dot(ray) > 0)) return false;
  // The order of the corners around n / h, which points away from the eye. Two adjacent corners may
  // be equal, but not the ends of a diagonal.
  const float order = (corners[2] - corners[0]).cross(corners[3] - corners[1]).dot(face.inverse);
  for (std::size_t i = 0; i < 4; ++i) {
    if (corners[i].cross(corners[(i + 1) % 4]).dot(ray) * order < 0) return false;
  }
  return true;
}

class LensPainter {
 public:
  LensPainter(const Intrinsics& pinhole, const std::vector<std::uint32_t>& numbers,
              const std::vector<FaceInView>& faces)
      : pinhole_(pinhole), numbers_(numbers), faces_(faces) {}

  Hit At(const Eigen::Vector2f& direction) const {
    const Eigen::Vector3f ray = direction.homogeneous();
    const double u = pinhole_.fx * direction.x() + pinhole_.cx;
    const double v = pinhole_.fy * direction.y() + pinhole_.cy;
    const int left = static_cast<int>(u), top = static_cast<int>(v);
    const std::array<std::uint32_t, 4> near = {Number(left, top), Number(left + 1, top),
                                               Number(left, top + 1), Number(left + 1, top + 1)};
    if (near[0] == near[1] && near[0] == near[2] && near[0] == near[3]) return HitOf(near[0], ray);
    Hit best;
    for (const std::uint32_t number : near) {
      if (number == 0 || number == best.number || !Meets(faces_[number - 1], ray)) continue;
      const Hit hit = HitOf(number, ray);
      if (best.number == 0 || hit.depth < best.depth) best = hit;
    }
    const bool open = std::find(near.begin(), near.end(), 0U) != near.end();
    // A crack between faces that touch: takes the nearest pixel's face.
    if (best.number == 0 && !open) {
      return HitOf(Number(static_cast<int>(std::lround(u)), static_cast<int>(std::lround(v))), ray);
    }
    return best;
  }

  /// Depth at which the ray (x, y, 1) meets the plane of the face. Outside of its polygon (OpenGL
  /// snaps corners to 1/256 px), a plane seen edge-on has any depth. So z is limited to the face's
  /// range.
  Hit HitOf(std::uint32_t number, const Eigen::Vector3f& ray) const {
    constexpr auto kNear = static_cast<float>(DepthRenderer::kNear);
    constexpr float kRounding = 1e-5F;  // m, of the corners themselves
    if (number == 0) return {};
    const FaceInView& face = faces_[number - 1];
    const float least = std::max(face.low_z, kNear) - kRounding, most = face.high_z + kRounding;
    const float inverse = face.inverse.dot(ray);
    return {inverse > 0 ? std::clamp(1 / inverse, least, most) : most, number};
  }

 private:
  std::uint32_t Number(int u, int v) const {
    return numbers_[static_cast<std::size_t>(v) * static_cast<std::size_t>(pinhole_.width) +
                    static_cast<std::size_t>(u)];
  }

  const Intrinsics& pinhole_;
  const std::vector<std::uint32_t>& numbers_;
  const std::vector<FaceInView>& faces_;
};

}  // namespace

LensPicture PlanLensPicture(const Intrinsics& lens) {
  LensPicture picture{lens, lens, ComputeRays(lens), {}};
  picture.pinhole.distortion.clear();
  picture.view_rays = ViewRays(picture.rays);
  if (lens.distortion.empty()) return picture;
  Eigen::Array2f low = Eigen::Array2f::Zero(), high = Eigen::Array2f::Zero();
  for (const Eigen::Vector2f& ray : picture.rays.rays) {
    if (!ray.allFinite()) continue;
    low = low.min(ray.array());
    high = high.max(ray.array());
  }
  Intrinsics& pinhole = picture.pinhole;
  pinhole.fx = kOversampling * lens.fx;
  pinhole.fy = kOversampling * lens.fy;
  pinhole.cx = std::ceil(kRim - low.x() * pinhole.fx);
  pinhole.cy = std::ceil(kRim - low.y() * pinhole.fy);
  pinhole.width = static_cast<int>(std::ceil(pinhole.cx + high.x() * pinhole.fx + kRim));
  pinhole.height = static_cast<int>(std::ceil(pinhole.cy + high.y() * pinhole.fy + kRim));
  return picture;
}

void DrawThroughLens(const LensPicture& picture, const std::vector<std::uint32_t>& numbers,
                     const std::vector<FaceInView>& faces, RenderedView* view) {
  const LensPainter painter(picture.pinhole, numbers, faces);
  view->rays = picture.view_rays;
  const bool is_pinhole = picture.lens.distortion.empty();
  for (std::size_t i = 0; i < view->depth.size(); ++i) {
    const Eigen::Vector2f& ray = picture.rays.rays[i];
    const Hit hit = is_pinhole        ? painter.HitOf(numbers[i], ray.homogeneous())
                    : ray.allFinite() ? painter.At(ray)
                                      : Hit();
    const std::uint32_t id = hit.number == 0 ? 0 : faces[hit.number - 1].id;
    view->depth[i] = hit.depth;
    view->labels[i] = static_cast<std::uint8_t>(id >> 16);
    view->faces[i] = static_cast<std::uint16_t>(id);
  }
}

}  // namespace volalign
