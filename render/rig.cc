#include "render/rig.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

#include "core/error.h"
#include "core/image_size.h"
#include "core/random.h"
#include "core/structure_gltf.h"
#include "render/depth_renderer.h"
#include "render/noise.h"
#include "render/scene.h"

namespace volalign {
namespace {

// Rigs draw from indices of their own, so that no rig repeats a training sample's room.
constexpr std::uint64_t kRigIndex = std::uint64_t{1} << 62;

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

}  // namespace

RigCapture RenderRig(const Rig& rig, DepthRenderer& renderer) {
  RigCapture capture;
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
  scene.room_probability = 1;
  if (!rig.room) {
    scene.room_probability = scene.distractor_probability = scene.occluder_probability = 0;
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
    sensor.intrinsics = DrawIntrinsics(rig.sensors[i], pool, rig.intrinsics, rig.seed, index);
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
