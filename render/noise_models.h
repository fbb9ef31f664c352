#pragma once

#include "core/random.h"
#include "render/noise.h"

namespace volalign {

/// Paper, "Implementation details": zero depth along the structure's outline and its boxes' depth
/// edges, and elliptical holes.
NoisyView PaperNoise(const NoiseConfig& config, const NoiseInput& input, RandomStream& random);

/// Rounds depths to the millimetre, as sensors deliver them. Where `keep` is 0 or the depth is not
/// positive, depth and label become 0.
void RoundKept(const Image<std::uint8_t>& keep, NoisyView* view);

/// Time of flight (docs/sensor-models.md): white noise that grows with distance and
/// incidence, a smooth warp, a bias of the frame, multipath in concave corners, gaps and few flying
/// pixels at depth edges, dark and grazing surfaces lost.
struct TofModel {
  bool hexagon = false;  ///< Azure Kinect's illumination mask, valid region |u - u0| <= 175.2 - k
                         ///< |v - v0| at 320x288
};
NoisyView TofNoise(const TofModel& model, const NoiseInput& input, RandomStream& random);

/// Stereo and structured light (docs/sensor-models.md): noise in disparity, z = f B / d.
struct StereoModel {
  double native_width = 1280;              ///< px, of the resolution that the next figures are for
  double focal_baseline = 51.9;            ///< f B, px m
  double local_sigma[2] = {0.045, 0.065};  ///< px rms, range drawn from
  double warp_sigma[2] = {0.08, 0.19};     ///< px rms
  double largest_disparity = 126;          ///< px; nearer surfaces are not matched
};
NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random);

}  // namespace volalign
