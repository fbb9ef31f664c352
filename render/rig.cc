#include "render/rig.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

#include "core/error.h"
#include "core/image_size.h"
#include "core/input_file.h"
#include "core/random.h"
#include "core/structure_gltf.h"
#include "render/depth_renderer.h"
#include "render/noise.h"
#include "render/scene.h"

namespace volalign {
namespace {

// Rigs draw from indices of their own, so that no rig repeats a training sample's room.
constexpr std::uint64_t kRigIndex = std::uint64_t{1} << 62;

constexpr double kSpreadRadius = 0.6;  // on the plane z = 1: the sides of an Azure Kinect's image

Intrinsics DrawIntrinsics(const RigSensor& sensor, const std::vector<IntrinsicsPoolEntry>& pool,
                          const std::string& pool_name, std::uint64_t seed, std::uint64_t index) {
  const bool native = sensor.image_size.empty();
  const ImageSize size = native ? ImageSize{} : ParseImageSize(sensor.image_size);
  std::vector<const Intrinsics*> choices;
  for (const IntrinsicsPoolEntry& entry : pool) {
    if (entry.sensor != sensor.sensor) continue;
    for (const Intrinsics& intrinsics : entry.intrinsics) {
      const bool fits = native ? choices.empty() || (choices[0]->width == intrinsics.width &&
                                                     choices[0]->height == intrinsics.height)
                               : SameAspect(intrinsics, size);
      if (fits) choices.push_back(&intrinsics);
    }
  }
  if (choices.empty()) {
    throw ConfigError(fmt::format("sensors: {} is a {}{}, which {} does not have", sensor.name,
                                  sensor.sensor, native ? "" : " of " + sensor.image_size,
                                  pool_name));
  }
  RandomStream random(seed, index, "sensor");
  const Intrinsics& drawn =
      *choices[static_cast<std::size_t>(random.Below(static_cast<int>(choices.size())))];
  if (!native) return drawn.Resized(size.width, size.height);
  if (drawn.width <= 640) return drawn;
  return drawn.Resized(drawn.width / 4, drawn.height / 4);
}

/// The intrinsics of a device that deviates from its kind: the focal length, and the radial factor
/// at kSpreadRadius, through k1.
Intrinsics Deviating(Intrinsics intrinsics, double spread, std::uint64_t seed,
                     std::uint64_t index) {
  if (spread == 0) return intrinsics;
  RandomStream random(seed, index, "lens");
  const double focal = 1 + spread * random.Normal();
  const double radial = spread * random.Normal();
  intrinsics.fx *= focal;
  intrinsics.fy *= focal;
  std::vector<double>& k = intrinsics.distortion;  // k1 k2 p1 p2 k3 k4 k5 k6
  if (k.empty()) k.assign(4, 0);
  constexpr double kR2 = kSpreadRadius * kSpreadRadius;
  // The radial factor is numerator / denominator, and k1 r^2 a term of the numerator.
  const double k3 = k.size() > 4 ? k[4] : 0;
  k[0] += radial * (1 + kR2 * (k[0] + kR2 * (k[1] + kR2 * k3))) / kR2;
  return intrinsics;
}

}  // namespace

RigCapture RenderRig(const Rig& rig, DepthRenderer& renderer) {
  RigCapture capture;
  RequireInputFile("structure", rig.structure);
  RequireInputFile("intrinsics", rig.intrinsics);
  capture.structure = ReadStructure(rig.structure);
  capture.structure_present = rig.structure_present;
  const std::vector<IntrinsicsPoolEntry> pool = ReadIntrinsicsPool(rig.intrinsics);
  AssembledStructure built = Assemble(capture.structure, rig.assembly, rig.seed, kRigIndex);
  const double floor = capture.structure.FloorHeight();

  SceneOptions options;
  options.structure_from_room = built.structure_from_room;
  options.structure_present = rig.structure_present;
  for (const RigSensor& sensor : rig.sensors) {
    options.structure_from_sensors.push_back(RigSensorPose(sensor, rig.structure_yaw_deg, floor));
  }
  SceneConfig scene = rig.scene;
  options.room_probability = rig.room ? 1 : 0;
  if (!rig.room) {
    scene.distractor_probability = scene.occluder_probability = 0;
    scene.clutter_count = {0, 0};
    scene.tripod_count = {0, 0};
  }
  const SceneMesh shared = BuildScene(scene, built.structure, options, rig.seed, kRigIndex);

  NoiseConfig noise;
  noise.model = rig.noise;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const std::uint64_t index = kRigIndex + i;
    CapturedSensor sensor;
    sensor.name = rig.sensors[i].name;
    sensor.sensor = rig.sensors[i].sensor;
    sensor.structure_from_sensor = options.structure_from_sensors[i];
    sensor.stated_intrinsics =
        DrawIntrinsics(rig.sensors[i], pool, rig.intrinsics, rig.seed, index);
    sensor.intrinsics =
        Deviating(sensor.stated_intrinsics, 0.01 * rig.lens_spread_percent, rig.seed, index);
    if (!rig.state_lens) sensor.stated_intrinsics.distortion.clear();
    SceneMesh mesh = shared;
    for (std::size_t other = 0; rig.room && rig.tripods && other < rig.sensors.size(); ++other) {
      if (other != i) AppendTripod(options.structure_from_sensors[other], floor, &mesh);
    }
    RenderedView view;
    renderer.Render(mesh, sensor.intrinsics, sensor.structure_from_sensor, &view);
    NoisyView noisy = ApplyNoise(noise,
                                 {view, mesh, built.structure, sensor.intrinsics,
                                  sensor.structure_from_sensor, sensor.sensor},
                                 rig.seed, index);
    sensor.depth = std::move(noisy.depth);
    sensor.labels = std::move(noisy.labels);
    sensor.depth_clean = std::move(view.depth);
    sensor.labels_clean = std::move(view.labels);
    capture.sensors.push_back(std::move(sensor));
  }
  capture.box_offsets = std::move(built.box_offsets);
  capture.size_scale = built.size_scale;
  return capture;
}

}  // namespace volalign
