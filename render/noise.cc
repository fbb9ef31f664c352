#include "render/noise.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <variant>

#include "core/base/error.h"
#include "core/base/random.h"
#include "render/noise_models.h"

namespace volalign {
namespace {

constexpr double kRealSenseWidth = 1280;  // px, of the depth image at full resolution

/// A stereo camera of 1280 px with the focal length of its intrinsics. The noise in disparity is
/// the D415's, the only one that was measured.
StereoModel RealSense(double baseline_m, const Intrinsics& intrinsics) {
  StereoModel model;
  model.native_width = kRealSenseWidth;
  model.focal_baseline = baseline_m * intrinsics.fx * kRealSenseWidth / intrinsics.width;
  return model;
}

using SensorModel = std::variant<TofModel, StereoModel>;

/// Narrow modes light a hexagon. Wide ones, with square pictures, light all of the picture.
SensorModel AzureKinect(const Intrinsics& intrinsics) {
  return TofModel{/*hexagon=*/intrinsics.width != intrinsics.height};
}

/// A kind of sensor: its pool names begin with the prefix.
struct ModelledKind {
  const char* prefix;
  SensorModel (*model)(const Intrinsics& intrinsics);
};
/// Baselines: Intel, RealSense product family D400 series datasheet (337029), table of the depth
/// modules; Luxonis, OAK-D (75 mm).
constexpr std::array<ModelledKind, 8> kKinds = {{
    {"azure_kinect", AzureKinect},
    {"orbbec_femto", AzureKinect},
    {"kinect_v2", [](const Intrinsics&) -> SensorModel { return TofModel{/*hexagon=*/false}; }},
    // 55 mm, f = 943.6 px.
    {"realsense_d415", [](const Intrinsics&) -> SensorModel { return StereoModel(); }},
    {"realsense_d435", [](const Intrinsics& k) -> SensorModel { return RealSense(0.050, k); }},
    {"realsense_d455", [](const Intrinsics& k) -> SensorModel { return RealSense(0.095, k); }},
    {"oak_d", [](const Intrinsics& k) -> SensorModel { return RealSense(0.075, k); }},
    // B = 75 mm, f = 580 px at 640x480; Nguyen et al. 2012 give sigma_z = 6 mm at 2 m, 0.07 px.
    {"kinect_v1",
     [](const Intrinsics&) -> SensorModel {
       return StereoModel{640, 43.5, {0.05, 0.09}, {0.03, 0.12}, 90};
     }},
}};

/// Null for a sensor without a model.
const ModelledKind* KindOf(const std::string& sensor) {
  const auto found = std::find_if(kKinds.begin(), kKinds.end(), [&](const ModelledKind& kind) {
    return sensor.rfind(kind.prefix, 0) == 0;
  });
  return found == kKinds.end() ? nullptr : &*found;
}

std::map<std::string, NoiseModel>& Registered() {
  static std::map<std::string, NoiseModel> registered;
  return registered;
}

}  // namespace

void RegisterNoiseModel(const std::string& name, NoiseModel model) {
  std::vector<std::string>& names = NoiseModelNames();
  if (std::count(names.begin(), names.end(), name) > 0)
    throw Error(fmt::format("there is a noise model '{}' already", name));
  names.push_back(name);
  Registered()[name] = std::move(model);
}

void RequireNoiseModels(const std::string& key, const std::vector<std::string>& models,
                        const std::string& sensor) {
  for (std::size_t i = 0; i < models.size(); ++i) {
    if (models[i] == "physics" && i > 0) {
      throw ConfigError(
          fmt::format("{}: physics measures the scene itself; name it first in the list", key));
    }
    if ((models[i] != "sensor" && models[i] != "physics") || KindOf(sensor) != nullptr) continue;
    std::string kinds;
    for (const ModelledKind& kind : kKinds)
      kinds += fmt::format("{}{}*", kinds.empty() ? "" : ", ", kind.prefix);
    throw ConfigError(fmt::format("{} = {}: no model for sensor {}, but for {}; use paper or none",
                                  key, models[i], sensor, kinds));
  }
}

VOLALIGN_CLONES void FindFaceEdges(const std::uint16_t* faces, const std::uint16_t* below,
                                   int count, std::uint8_t* __restrict edges) {
  for (int u = 0; u + 1 < count; ++u) {
    edges[u] = static_cast<std::uint8_t>((faces[u] != faces[u + 1]) | (faces[u] != below[u]) << 1);
  }
  edges[count - 1] = static_cast<std::uint8_t>((faces[count - 1] != below[count - 1]) << 1);
}

namespace {

VOLALIGN_CLONES void Round(const std::uint8_t* __restrict keep, std::size_t count,
                           float* __restrict depth, std::uint8_t* __restrict labels) {
  for (std::size_t i = 0; i < count; ++i) {
    const bool kept = (keep[i] != 0) & !(depth[i] <= 0);
    depth[i] = kept ? std::nearbyint(depth[i] * 1000) * 0.001F : 0.0F;
    labels[i] = kept ? labels[i] : std::uint8_t{0};
  }
}

}  // namespace

void RoundKept(const Image<std::uint8_t>& keep, NoisyView* view) {
  Round(keep.data(), keep.size(), view->depth.data(), view->labels.data());
}

namespace {

NoisyView ApplyModel(const std::string& name, const NoiseConfig& config, const NoiseInput& input,
                     RandomStream& random, DeviceErrors* device) {
  if (name == "none") return {input.view.depth, input.view.labels};
  if (name == "paper") return PaperNoise(config, input, random);
  if (const auto own = Registered().find(name); own != Registered().end())
    return own->second(input, random);
  const SensorModel model = KindOf(input.sensor)->model(input.intrinsics);
  if (name == "physics") {
    if (!device->seed)
      device->seed = static_cast<std::uint64_t>(random.NextU32()) << 32 | random.NextU32();
    if (const auto* tof = std::get_if<TofModel>(&model))
      return TofPhysics(*tof, input, *device->seed, random);
    return StereoPhysics(std::get<StereoModel>(model), input, *device->seed, random);
  }
  if (const auto* tof = std::get_if<TofModel>(&model))
    return TofNoise(*tof, input, random, &device->tof);
  return StereoNoise(std::get<StereoModel>(model), input, random, &device->stereo);
}

}  // namespace

NoisyView ApplyNoise(const NoiseConfig& config, const NoiseInput& input, std::uint64_t seed,
                     std::uint64_t index, DeviceErrors* device) {
  RequireNoiseModels("noise.models", config.models, input.sensor);
  RandomStream random(seed, index, "noise");
  DeviceErrors drawn;
  if (!device) device = &drawn;
  NoisyView seen{input.view.depth, input.view.labels};
  RenderedView view = input.view;
  for (const std::string& model : config.models) {
    for (std::size_t i = 0; i < view.faces.size(); ++i) {
      if (seen.depth[i] == 0) view.faces[i] = 0;
    }
    view.depth = std::move(seen.depth);
    view.labels = std::move(seen.labels);
    const NoiseInput left{
        view,        input.mesh, input.structure, input.intrinsics, input.structure_from_sensor,
        input.sensor};
    seen = ApplyModel(model, config, left, random, device);
  }
  return seen;
}

}  // namespace volalign
