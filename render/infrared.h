#pragma once

#include <cstdint>
#include <vector>

#include "core/base/image.h"
#include "core/config/config.h"
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
  double marker_m = 0.16;
  double quiet_zone_m = 0.025;
  int supersampling = 2;
  double blur_px = 0.7;
  double exposure = 0.6;
  double full_well_electrons = 5000;
  double read_noise_electrons = 10;
  double black = 0.08;
  double white = 0.85;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("marker_m", marker_m, "edge of a marker's black square, m", Above(0));
    ar("quiet_zone_m", quiet_zone_m, "white paper around it, m", AtLeast(0));
    ar("supersampling", supersampling, "rays per pixel along each axis", Between(1, 8));
    ar("blur_px", blur_px, "standard deviation of the lens's point spread, px", AtLeast(0));
    ar("exposure", exposure,
       "share of full scale to which the brightest tenth of the picture is exposed", Between(0, 1));
    ar("full_well_electrons", full_well_electrons,
       "electrons at full scale, which give the shot noise of the picture; 0: no noise at all",
       AtLeast(0));
    ar("read_noise_electrons", read_noise_electrons,
       "standard deviation of the read-out, electrons", AtLeast(0));
    ar("black", black, "share of the infrared light that black print reflects", Between(0, 1));
    ar("white", white, "share that paper reflects", Between(0, 1));
  }
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
