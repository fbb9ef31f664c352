#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/geometry/camera.h"

namespace volalign {

struct RenderedView;

/// A corner of a face for drawing.
struct FaceCorner {
  Eigen::Vector3f position;       ///< sensor frame, m
  Eigen::Vector3f inverse_plane;  ///< n / h of the face n . p = h, sensor frame
  float z_min, z_max;             ///< of the face, m
  std::uint32_t id;               ///< label << 16 | 1 + face index
};

/// Plan for drawing a camera from a picture of each pixel's face. Without a lens, it is the
/// camera's own. With a lens, it is a pinhole picture of its whole field of view, which gives the
/// candidates for a pixel. The pixel's own ray decides the face and the depth.
struct LensPicture {
  Intrinsics lens;
  Intrinsics pinhole;                         ///< of the pinhole picture
  RayTable rays;                              ///< of the lens; NaN beyond its fold
  std::shared_ptr<const RayTable> view_rays;  ///< RenderedView::rays
};

/// Throws DataError for a lens that ComputeRays cannot invert.
LensPicture PlanLensPicture(const Intrinsics& lens);

/// Fills the view, whose images have the lens's size. `ids` are FaceCorner::id of the pinhole
/// picture's pixels, 0 without a face. The face of index i has four corners in `corners`, from
/// first_corner[i] on. Depth is where a pixel's ray meets the face's plane, exact to float
/// rounding. Silhouettes are exact, except for details smaller than a pixel of the pinhole picture.
void DrawThroughLens(const LensPicture& picture, const std::vector<std::uint32_t>& ids,
                     const std::vector<FaceCorner>& corners,
                     const std::vector<std::uint32_t>& first_corner, RenderedView* view);

}  // namespace volalign
