#pragma once

#include <cstdint>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/scene_mesh.h"

namespace volalign {

/// 8-bit grey values.
using GreyImage = Image<std::uint8_t>;

/// A square pattern on white paper in the middle of a side. Seen from outside, its columns run
/// along the side's axis_u and its rows against axis_v.
struct MarkerPrint {
  int label = 0;    ///< of the side
  GreyImage cells;  ///< 0 is black; includes its own black border
};

/// Properties of an infrared picture. The defaults were set before any result was seen, from the
/// left imagers of stereo depth cameras. These have a global shutter, 8 bits, pixels of 3 um for
/// some thousand electrons, and a lens that is sharp to about a pixel.
struct InfraredConfig {
  double marker_m = 0.16;             ///< edge of a marker's black square
  double quiet_zone_m = 0.025;        ///< white paper around it
  int supersampling = 2;              ///< rays per pixel along each axis
  double blur_px = 0.7;               ///< standard deviation of the lens's point spread
  double exposure = 0.6;              ///< share of full scale of the picture's brightest tenth
  double full_well_electrons = 5000;  ///< at full scale, for the shot noise; 0: no noise at all
  double read_noise_electrons = 10;   ///< standard deviation of the read-out
  double black = 0.08, white = 0.85;  ///< shares of the infrared light that print and paper reflect
};

/// The view of an infrared camera at a depth sensor's place, with markers on the structure. It is
/// drawn in the pass for depth and labels, and shaded: matt surfaces under room light and a lamp at
/// the camera, automatic exposure, blur, shot and read noise. The dots of a stereo sensor's
/// projector are left out. `built`: the structure that was drawn. Random stage "infrared".
GreyImage RenderInfrared(const SceneMesh& mesh, const Structure& built,
                         const std::vector<MarkerPrint>& prints, const Intrinsics& intrinsics,
                         const Pose& structure_from_sensor, const InfraredConfig& config,
                         DepthRenderer& renderer, std::uint64_t seed, std::uint64_t index);

}  // namespace volalign
