#include "render/rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/base/random.h"
#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/noise.h"
#include "render/scene.h"

namespace volalign {
namespace {

// Rigs have their own indices, so that no rig repeats a training sample's room.
constexpr std::uint64_t kRigIndex = std::uint64_t{1} << 62;

// Distance between the draws of two captures, larger than any number of sensors.
constexpr std::uint64_t kCaptureStride = std::uint64_t{1} << 32;

constexpr double kSpreadRadius = 0.6;  // on the plane z = 1: the sides of an Azure Kinect's image

Intrinsics DrawIntrinsics(const RigSensor& sensor, const std::vector<IntrinsicsPoolEntry>& pool,
                          const std::string& pool_name, std::uint64_t seed, std::uint64_t index) {
  const std::vector<Intrinsics> choices = IntrinsicsOf(sensor, pool, pool_name);
  RandomStream random(seed, index, "sensor");
  return choices[static_cast<std::size_t>(random.Below(static_cast<int>(choices.size())))];
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
  // The radial factor is numerator / denominator, and k1 r^2 is a term of the numerator.
  const double k3 = k.size() > 4 ? k[4] : 0;
  k[0] += radial * (1 + kR2 * (k[0] + kR2 * (k[1] + kR2 * k3))) / kR2;
  return intrinsics;
}

/// The structure as built at one placement.
struct BuiltPlacement {
  AssembledStructure built;
  Pose first_from_placement = Pose::Identity();
};

/// The first placement and the further ones, each stacked again from boxes of one size.
std::vector<BuiltPlacement> BuildPlacements(const Rig& rig, const Structure& nominal) {
  std::vector<BuiltPlacement> all;
  all.push_back({Assemble(nominal, rig.assembly, rig.seed, kRigIndex), Pose::Identity()});
  const AssembledStructure first = all[0].built;
  for (std::size_t k = 0; k < rig.placements.size(); ++k) {
    AssembledStructure built = Assemble(nominal, rig.assembly, rig.seed,
                                        kRigIndex + (k + 1) * kCaptureStride, first.size_scale);
    // Placements lie on the room's floor, which may be tilted against the structure.
    const Pose first_from_placement = first.structure_from_room *
                                      FirstFromPlacement(rig.placements[k]) *
                                      built.structure_from_room.inverse();
    all.push_back({std::move(built), first_from_placement});
  }
  return all;
}

/// The common parts of a rig's captures; poses in the frame of the first placement.
struct RigScene {
  std::vector<Pose> first_from_sensors;
  SceneMesh mesh;  ///< with the structure at its first place, without tripods
  double floor = 0;
};

RigScene BuildRigScene(const Rig& rig, const Structure& nominal,
                       const std::vector<BuiltPlacement>& placements) {
  RigScene out;
  out.floor = nominal.FloorHeight();
  SceneOptions options;
  options.structure_from_room = placements[0].built.structure_from_room;
  options.structure_present = rig.structure_present;
  for (const RigSensor& sensor : rig.sensors) {
    out.first_from_sensors.push_back(RigSensorPose(sensor, rig.structure_yaw_deg, out.floor));
  }
  options.structure_from_sensors = out.first_from_sensors;
  for (std::size_t k = 1; k < placements.size(); ++k) {
    options.elsewhere.push_back(
        {placements[k].first_from_placement, placements[k].built.structure});
    for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
      if (!StandsInTripod(options.elsewhere.back(), out.first_from_sensors[i])) continue;
      throw ConfigError(
          fmt::format("placements[{}] = {{x_cm: {}, z_cm: {}, yaw_deg: {}}} stands where sensor {} "
                      "and its tripod do; move one of them",
                      k - 1, rig.placements[k - 1].x_cm, rig.placements[k - 1].z_cm,
                      rig.placements[k - 1].yaw_deg, rig.sensors[i].name));
    }
  }
  SceneConfig scene = rig.scene;
  options.room_probability = rig.room ? 1 : 0;
  if (!rig.room) {
    scene.distractor_probability = scene.occluder_probability = 0;
    scene.clutter_count = {0, 0};
    scene.tripod_count = {0, 0};
  }
  out.mesh = BuildScene(scene, placements[0].built.structure, options, rig.seed, kRigIndex);
  return out;
}

/// Pose of a sensor in the frame of the first placement while the structure is at its k-th place.
Pose FirstFromSensor(const Rig& rig, const RigScene& scene, std::size_t k, std::size_t i) {
  Pose pose = scene.first_from_sensors[i];
  if (k == 0) return pose;
  for (const RigMovement& movement : rig.placements[k - 1].moved) {
    if (movement.sensor == rig.sensors[i].name) pose = pose * FirstFromMoved(movement);
  }
  return pose;
}

/// The infrared intrinsics, at the pool's largest size with the same aspect ratio.
Intrinsics InfraredIntrinsics(const CapturedSensor& sensor,
                              const std::vector<IntrinsicsPoolEntry>& pool) {
  ImageSize size{sensor.intrinsics.width, sensor.intrinsics.height};
  for (const IntrinsicsPoolEntry& entry : pool) {
    const Intrinsics& native = entry.intrinsics.front();
    if (entry.sensor == sensor.sensor && native.width > size.width &&
        SameAspect(native, {sensor.intrinsics.width, sensor.intrinsics.height})) {
      size = {native.width, native.height};
    }
  }
  return sensor.intrinsics.Resized(size.width, size.height);
}

/// A sensor without its images.
CapturedSensor DrawSensor(const Rig& rig, std::size_t i,
                          const std::vector<IntrinsicsPoolEntry>& pool) {
  const std::uint64_t index = kRigIndex + i;
  CapturedSensor sensor;
  sensor.name = rig.sensors[i].name;
  sensor.sensor = rig.sensors[i].sensor;
  sensor.stated_intrinsics = DrawIntrinsics(rig.sensors[i], pool, rig.intrinsics, rig.seed, index);
  RequireNoiseModels("noise", rig.noise, sensor.sensor);
  sensor.intrinsics =
      Deviating(sensor.stated_intrinsics, 0.01 * rig.lens_spread_percent, rig.seed, index);
  if (!rig.state_lens) sensor.stated_intrinsics.distortion.clear();
  return sensor;
}

/// Puts a board before each sensor (Rig::hidden_share).
void AppendBoards(const Rig& rig, const Structure& built,
                  const std::vector<CapturedSensor>& devices, RigScene* scene) {
  if (!(rig.hidden_share > 0) || !rig.structure_present) return;
  for (std::size_t i = 0; i < devices.size(); ++i) {
    RandomStream random(rig.seed, kRigIndex + i, "board");
    AppendBoard(built, ComputeRays(devices[i].intrinsics), scene->first_from_sensors[i],
                rig.hidden_share, static_cast<BoardEdge>(random.Below(kBoardEdges)), &scene->mesh);
  }
}

/// Removes the depth of a share of the pixels (Rig::missing_share).
void LosePixels(double share, std::uint64_t seed, std::uint64_t index, NoisyView* view) {
  if (!(share > 0)) return;
  RandomStream random(seed, index, "missing");
  for (std::size_t i = 0; i < view->depth.size(); ++i) {
    if (!random.Chance(share)) continue;
    view->depth[i] = 0;
    view->labels[i] = 0;
  }
}

}  // namespace

std::vector<RigCapture> RenderPlacements(const Rig& rig, DepthRenderer& renderer,
                                         const std::vector<MarkerPrint>* prints,
                                         const CountDone& count) {
  if (!rig.turns_deg.empty()) {
    throw Error("RenderPlacements: a rig with turns_deg has several captures");
  }
  RequireInputFile("structure", rig.structure);
  RequireInputFile("intrinsics", rig.intrinsics);
  const Structure nominal = ReadStructure(rig.structure);
  const std::vector<IntrinsicsPoolEntry> pool = ReadIntrinsicsPool(rig.intrinsics);
  const std::vector<BuiltPlacement> placements = BuildPlacements(rig, nominal);
  RigScene scene = BuildRigScene(rig, nominal, placements);
  std::vector<CapturedSensor> devices;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) devices.push_back(DrawSensor(rig, i, pool));
  AppendBoards(rig, placements[0].built.structure, devices, &scene);
  std::vector<RigCapture> captures;
  for (const BuiltPlacement& placement : placements) {
    captures.push_back({nominal,
                        rig.structure_present,
                        placement.first_from_placement,
                        placement.built.box_offsets,
                        placement.built.size_scale,
                        {}});
  }

  NoiseConfig noise;
  noise.models = rig.noise;
  const bool frame_errors = std::count(rig.noise.begin(), rig.noise.end(), "sensor") > 0;
  std::int64_t frames = 0;
  const auto frames_of_all = static_cast<std::int64_t>(rig.sensors.size() * captures.size());
  if (count) count(frames, frames_of_all);
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const CapturedSensor& device = devices[i];
    DeviceErrors errors;
    SceneMesh around = scene.mesh;
    for (std::size_t other = 0; rig.room && rig.tripods && other < rig.sensors.size(); ++other) {
      if (other != i) AppendTripod(scene.first_from_sensors[other], scene.floor, &around);
    }
    for (std::size_t k = 0; k < captures.size(); ++k) {
      const Structure& built = placements[k].built.structure;
      const Pose placement_from_first = placements[k].first_from_placement.inverse();
      const SceneMesh mesh = k == 0 ? around : MoveStructure(around, built, placement_from_first);
      CapturedSensor sensor = device;
      sensor.structure_from_sensor = placement_from_first * FirstFromSensor(rig, scene, k, i);
      RenderedView view;
      renderer.Render(mesh, sensor.intrinsics, sensor.structure_from_sensor, &view);
      const bool redrawn = rig.device_errors == DeviceErrorDraw::kRedrawn;
      if (redrawn) errors = {};
      const NoiseInput input = {
          view, mesh, built, sensor.intrinsics, sensor.structure_from_sensor, sensor.sensor};
      NoisyView noisy =
          ApplyNoise(noise, input, rig.seed, kRigIndex + k * kCaptureStride + i, &errors);
      if (frame_errors) {
        AddFrameErrors(
            input, {rig.seed, kRigIndex + (redrawn ? k : 0) * kCaptureStride + i, "frame"}, &noisy);
      }
      LosePixels(rig.missing_share, rig.seed, kRigIndex + k * kCaptureStride + i, &noisy);
      sensor.depth = std::move(noisy.depth);
      sensor.labels = std::move(noisy.labels);
      sensor.depth_clean = std::move(view.depth);
      sensor.labels_clean = std::move(view.labels);
      if (prints) {
        sensor.infrared_intrinsics = InfraredIntrinsics(sensor, pool);
        sensor.infrared = RenderInfrared(mesh, built, *prints, sensor.infrared_intrinsics,
                                         sensor.structure_from_sensor, InfraredConfig(), renderer,
                                         rig.seed, kRigIndex + k * kCaptureStride + i);
      }
      captures[k].sensors.push_back(std::move(sensor));
      if (count) count(++frames, frames_of_all);
    }
  }
  return captures;
}

std::vector<RigPlacement> DrawPlacements(const Rig& rig, int count, double radius_m) {
  constexpr int kAttempts = 200;
  constexpr double kGap = 0.05;  // m, for boxes slightly out of place
  RequireInputFile("structure", rig.structure);
  const Structure structure = ReadStructure(rig.structure);
  std::vector<RigPlacement> placements;
  for (int k = 0; k < count; ++k) {
    RandomStream random(rig.seed, static_cast<std::uint64_t>(k), "placements");
    RigPlacement placement;
    const auto stands_in_tripod = [&](const RigSensor& sensor) {
      return StandsInTripod({FirstFromPlacement(placement), structure},
                            RigSensorPose(sensor, rig.structure_yaw_deg, structure.FloorHeight()),
                            kGap);
    };
    bool free = false;
    for (int attempt = 0; attempt < kAttempts && !free; ++attempt) {
      const double rho = 100 * radius_m * std::sqrt(random.Uniform());
      const double phi = random.Uniform(0, 2 * M_PI);
      placement.x_cm = rho * std::cos(phi);
      placement.z_cm = rho * std::sin(phi);
      placement.yaw_deg = random.Uniform(0, 360);
      free = std::none_of(rig.sensors.begin(), rig.sensors.end(), stands_in_tripod);
    }
    if (!free) {
      throw ConfigError(fmt::format(
          "the sensors leave the structure no other place within {} m of its first", radius_m));
    }
    placements.push_back(placement);
  }
  return placements;
}

}  // namespace volalign
