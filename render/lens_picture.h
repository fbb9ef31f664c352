#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/geometry/camera.h"
#include "render/depth_renderer.h"

namespace volalign {

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

/// Fills the view, whose images have the lens's size. `numbers`, of the pinhole picture's pixels,
/// are 1 + an index into `faces`, or 0 without a face. Depth is where a pixel's ray meets the
/// face's plane, exact to float rounding. Silhouettes are exact, except for details smaller than a
/// pixel of the pinhole picture.
void DrawThroughLens(const LensPicture& picture, const std::vector<std::uint32_t>& numbers,
                     const std::vector<FaceInView>& faces, RenderedView* view);

}  // namespace volalign
