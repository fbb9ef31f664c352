#include "render/lens_picture.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/geometry/lens.h"
#include "render/depth_renderer.h"

namespace volalign {
namespace {

/// Pixels of the pinhole picture per pixel in the middle of the image, along an axis.
constexpr double kOversampling = 2;
/// Pixels of the pinhole picture beyond the outermost rays.
constexpr double kRim = 2;

struct Hit {
  float depth = std::numeric_limits<float>::infinity();
  std::uint32_t id = 0;
};

/// Depth at which the ray (x, y, 1) meets the plane of the face. Outside of its polygon (OpenGL
/// snaps corners to 1/256 px), a plane seen edge-on has any depth. So z is limited to the face's
/// range.
float DepthOf(const FaceCorner& face, const Eigen::Vector3f& ray) {
  const float inverse = face.inverse_plane.dot(ray);
  return inverse > 0 ? std::clamp(1 / inverse, face.z_min, face.z_max) : face.z_max;
}

/// Does the ray (x, y, 1) pass through the face, a convex polygon that is at least partly in front
/// of the camera? The ray has to be on the inner side of the planes through the eye and each edge.
bool Meets(const FaceCorner* corners, const Eigen::Vector3f& ray) {
  if (!(corners->inverse_plane.dot(ray) > 0)) return false;
  // The order of the corners around n / h, which points away from the eye. Two adjacent corners may
  // be equal, but not the ends of a diagonal.
  const float order = (corners[2].position - corners[0].position)
                          .cross(corners[3].position - corners[1].position)
                          .dot(corners->inverse_plane);
  for (int i = 0; i < 4; ++i) {
    const float side = corners[i].position.cross(corners[(i + 1) % 4].position).dot(ray);
    if (side * order < 0) return false;
  }
  return true;
}

class LensPainter {
 public:
  LensPainter(const LensPicture& picture, const std::vector<std::uint32_t>& ids,
              const std::vector<FaceCorner>& corners,
              const std::vector<std::uint32_t>& first_corner)
      : pinhole_(picture.pinhole), ids_(ids), corners_(corners), first_corner_(first_corner) {}

  Hit At(const Eigen::Vector2f& direction) const {
    const Eigen::Vector3f ray = direction.homogeneous();
    const double u = pinhole_.fx * direction.x() + pinhole_.cx;
    const double v = pinhole_.fy * direction.y() + pinhole_.cy;
    const int left = static_cast<int>(u), top = static_cast<int>(v);
    const std::array<std::uint32_t, 4> near = {Id(left, top), Id(left + 1, top), Id(left, top + 1),
                                               Id(left + 1, top + 1)};
    if (near[0] == near[1] && near[0] == near[2] && near[0] == near[3]) return HitOf(near[0], ray);
    Hit best;
    for (const std::uint32_t id : near) {
      if (id == 0 || id == best.id || !Meets(CornersOf(id), ray)) continue;
      const Hit hit = HitOf(id, ray);
      if (hit.depth < best.depth) best = hit;
    }
    const bool open = std::find(near.begin(), near.end(), 0U) != near.end();
    // A crack between faces that touch: takes the nearest pixel's face.
    if (best.id == 0 && !open) {
      return HitOf(Id(static_cast<int>(std::lround(u)), static_cast<int>(std::lround(v))), ray);
    }
    return best.id == 0 ? Hit{0, 0} : best;
  }

  Hit HitOf(std::uint32_t id, const Eigen::Vector3f& ray) const {
    return id == 0 ? Hit{0, 0} : Hit{DepthOf(*CornersOf(id), ray), id};
  }

 private:
  std::uint32_t Id(int u, int v) const {
    return ids_[static_cast<std::size_t>(v) * static_cast<std::size_t>(pinhole_.width) +
                static_cast<std::size_t>(u)];
  }
  const FaceCorner* CornersOf(std::uint32_t id) const {
    return &corners_[first_corner_[(id & 0xFFFFU) - 1]];
  }

  const Intrinsics& pinhole_;
  const std::vector<std::uint32_t>& ids_;
  const std::vector<FaceCorner>& corners_;
  const std::vector<std::uint32_t>& first_corner_;
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

void DrawThroughLens(const LensPicture& picture, const std::vector<std::uint32_t>& ids,
                     const std::vector<FaceCorner>& corners,
                     const std::vector<std::uint32_t>& first_corner, RenderedView* view) {
  const LensPainter painter(picture, ids, corners, first_corner);
  view->rays = picture.view_rays;
  const bool is_pinhole = picture.lens.distortion.empty();
  for (std::size_t i = 0; i < view->depth.size(); ++i) {
    const Eigen::Vector2f& ray = picture.rays.rays[i];
    const Hit hit = is_pinhole        ? painter.HitOf(ids[i], ray.homogeneous())
                    : ray.allFinite() ? painter.At(ray)
                                      : Hit{0, 0};
    view->depth[i] = hit.depth;
    view->labels[i] = static_cast<std::uint8_t>(hit.id >> 16);
    view->faces[i] = static_cast<std::uint16_t>(hit.id);
  }
}

}  // namespace volalign
