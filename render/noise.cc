#include "render/noise.h"

#include <fmt/format.h>

#include <cmath>

#include "core/error.h"
#include "core/random.h"
#include "render/noise_models.h"

namespace volalign {
namespace {

bool StartsWith(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

}  // namespace

bool HasSensorModel(const std::string& sensor) {
  return StartsWith(sensor, "azure_kinect") || StartsWith(sensor, "kinect_v2") ||
         StartsWith(sensor, "realsense_d4") || StartsWith(sensor, "kinect_v1");
}

void RoundKept(const Image<std::uint8_t>& keep, NoisyView* view) {
  for (std::size_t i = 0; i < keep.size(); ++i) {
    if (!keep[i] || view->depth[i] <= 0) {
      view->depth[i] = 0;
      view->labels[i] = 0;
    } else {
      view->depth[i] = std::nearbyint(view->depth[i] * 1000) * 0.001F;
    }
  }
}

NoisyView ApplyNoise(const NoiseConfig& config, const NoiseInput& input, std::uint64_t seed,
                     std::uint64_t index) {
  RandomStream random(seed, index, "noise");
  if (config.model == "none") return {input.view.depth, input.view.labels};
  if (config.model == "paper") return PaperNoise(config, input, random);
  if (StartsWith(input.sensor, "azure_kinect")) return TofNoise({/*hexagon=*/true}, input, random);
  if (StartsWith(input.sensor, "kinect_v2")) return TofNoise({/*hexagon=*/false}, input, random);
  if (StartsWith(input.sensor, "realsense_d4")) return StereoNoise({}, input, random);
  if (StartsWith(input.sensor, "kinect_v1")) {
    // B = 75 mm, f = 580 px at 640x480; Nguyen et al. 2012 give sigma_z = 6 mm at 2 m, 0.07 px.
    return StereoNoise({640, 43.5, {0.05, 0.09}, {0.03, 0.12}, 90}, input, random);
  }
  throw ConfigError(
      fmt::format("noise.model = sensor: no model for sensor {}; use paper or none", input.sensor));
}

}  // namespace volalign
