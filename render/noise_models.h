#pragma once

#include <optional>

#include "core/base/random.h"
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
/// `device` is used where it stands, and else drawn. It is the first frame's numbers that a device
/// keeps, so that a single frame is the same whether its device has others or not.
NoisyView TofNoise(const TofModel& model, const NoiseInput& input, RandomStream& random,
                   std::optional<TofDevice>* device);

/// Stereo and structured light (docs/sensor-models.md): noise in disparity, z = f B / d. The
/// defaults are a D415's.
struct StereoModel {
  double native_width = 1280;              ///< px, of the resolution that the next figures are for
  double focal_baseline = 51.9;            ///< f B, px m
  double local_sigma[2] = {0.045, 0.065};  ///< px rms, range drawn from
  double warp_sigma[2] = {0.08, 0.19};     ///< px rms
  double largest_disparity = 126;          ///< px; nearer surfaces are not matched
};
/// `device` as in TofNoise.
NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random,
                      std::optional<StereoDevice>* device);

}  // namespace volalign
