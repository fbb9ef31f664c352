#include "render/noise.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "core/error.h"
#include "core/random.h"
#include "render/noise_models.h"

namespace volalign {
namespace {

constexpr double kRealSenseWidth = 1280;  // px, of the depth image at full resolution

bool StartsWith(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

/// A D400 camera whose focal length is that of its intrinsics. The noise in disparity is the
/// D415's, the only one that was measured.
StereoModel RealSense(double baseline_m, const Intrinsics& intrinsics) {
  StereoModel model;
  model.native_width = kRealSenseWidth;
  model.focal_baseline = baseline_m * intrinsics.fx * kRealSenseWidth / intrinsics.width;
  return model;
}

/// Of a stereo or structured-light sensor; none for others. Baselines: Intel, RealSense product
/// family D400 series datasheet (337029), table of the depth modules.
std::optional<StereoModel> StereoModelOf(const std::string& sensor, const Intrinsics& intrinsics) {
  if (StartsWith(sensor, "realsense_d415")) return StereoModel();  // 55 mm, f = 943.6 px
  if (StartsWith(sensor, "realsense_d435")) return RealSense(0.050, intrinsics);
  if (StartsWith(sensor, "realsense_d455")) return RealSense(0.095, intrinsics);
  if (StartsWith(sensor, "kinect_v1")) {
    // B = 75 mm, f = 580 px at 640x480; Nguyen et al. 2012 give sigma_z = 6 mm at 2 m, 0.07 px.
    return StereoModel{640, 43.5, {0.05, 0.09}, {0.03, 0.12}, 90};
  }
  return std::nullopt;
}

/// Of a time-of-flight sensor; none for others.
std::optional<TofModel> TofModelOf(const std::string& sensor) {
  if (StartsWith(sensor, "azure_kinect")) return TofModel{/*hexagon=*/true};
  if (StartsWith(sensor, "kinect_v2")) return TofModel{/*hexagon=*/false};
  return std::nullopt;
}

}  // namespace

bool HasSensorModel(const std::string& sensor) {
  return TofModelOf(sensor).has_value() || StereoModelOf(sensor, Intrinsics{1, 1, 1, 1, 0, 0, {}});
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
                     std::uint64_t index, DeviceErrors* device) {
  RandomStream random(seed, index, "noise");
  DeviceErrors drawn;
  if (!device) device = &drawn;
  if (config.model == "none") return {input.view.depth, input.view.labels};
  if (config.model == "paper") return PaperNoise(config, input, random);
  if (const auto model = TofModelOf(input.sensor)) {
    return TofNoise(*model, input, random, &device->tof);
  }
  if (const auto model = StereoModelOf(input.sensor, input.intrinsics)) {
    return StereoNoise(*model, input, random, &device->stereo);
  }
  throw ConfigError(
      fmt::format("noise.model = sensor: no model for sensor {}, but for {}; use paper or none",
                  input.sensor, kSensorModels));
}

}  // namespace volalign
