#include "render/rig.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>

#include "core/error.h"
#include "core/random.h"
#include "core/structure_gltf.h"
#include "render/depth_renderer.h"
#include "render/image_size.h"
#include "render/noise.h"
#include "render/scene.h"

namespace volalign {
namespace {

constexpr double kPi = 3.14159265358979323846;
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

Rig ReadRig(const ConfigSource& source) {
  Rig rig = ReadConfig<Rig>(source);
  if (rig.sensors.empty()) {
    throw ConfigError("sensors = [] has no sensor; give at least one {name: A, phi_deg: 0}");
  }
  std::set<std::string> names;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const RigSensor& sensor = rig.sensors[i];
    const bool plain = std::all_of(sensor.name.begin(), sensor.name.end(), [](unsigned char c) {
      return std::isalnum(c) || c == '_' || c == '-';
    });
    if (sensor.name.empty() || !plain) {
      throw ConfigError(fmt::format(
          "sensors[{}].name = \"{}\" is not made of letters, digits, _ and -", i, sensor.name));
    }
    if (!names.insert(sensor.name).second) {
      throw ConfigError(
          fmt::format("sensors[{}].name = {} stands twice; names are unique", i, sensor.name));
    }
    if (!sensor.image_size.empty()) ParseImageSize(sensor.image_size);
  }
  return rig;
}

Pose RigSensorPose(const RigSensor& sensor, double structure_yaw_deg, double floor_height) {
  const double phi = sensor.phi_deg * kPi / 180;
  const Eigen::Vector3d position(0.01 * sensor.rho_cm * std::cos(phi),
                                 floor_height + 0.01 * sensor.height_cm,
                                 0.01 * sensor.rho_cm * std::sin(phi));
  const Eigen::Vector3d target(0.01 * sensor.look_at_cm[0], 0.01 * sensor.look_at_cm[1],
                               0.01 * sensor.look_at_cm[2]);
  const Pose structure_from_rig(
      Eigen::AngleAxisd(-structure_yaw_deg * kPi / 180, Eigen::Vector3d::UnitY()));
  return structure_from_rig * LookAt(position, target, sensor.roll_deg * kPi / 180);
}

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
