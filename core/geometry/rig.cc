#include "core/geometry/rig.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/random.h"
#include "core/base/text.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"

namespace volalign {
namespace {

constexpr std::uint64_t kTurnStride = 1000000;  // difference of the seeds of two turns

/// Appends a group's sensors. Throws ConfigError.
void AppendGroup(const RigGroup& group, std::size_t index, std::vector<RigSensor>* sensors) {
  if (group.phi_deg.empty() || group.height_cm.empty()) {
    throw ConfigError(
        fmt::format("groups[{}] has no sensor; phi_deg and height_cm want an element each", index));
  }
  const std::size_t count = std::max(group.phi_deg.size(), group.height_cm.size());
  for (std::size_t i = 0; i < count; ++i) {
    sensors->push_back({group, fmt::format("{}{}", group.name, i + 1),
                        group.phi_deg[i % group.phi_deg.size()],
                        group.height_cm[i % group.height_cm.size()]});
  }
}

/// Draws the points that sensors look at, each about its own, by the rig's seed.
void DrawLookAt(Rig* rig) {
  for (std::size_t i = 0; i < rig->sensors.size(); ++i) {
    RigSensor& sensor = rig->sensors[i];
    RandomStream random(rig->seed, i, "look_at");
    const Eigen::Vector3d offset = PointInBall(sensor.look_at_radius_cm, random);
    for (int axis = 0; axis < 3; ++axis)
      sensor.look_at_cm[static_cast<std::size_t>(axis)] += offset[axis];
    sensor.look_at_radius_cm = 0;
  }
}

}  // namespace

Rig ReadRig(const ConfigSource& source) {
  Rig rig = ReadConfig<Rig>(source);
  for (std::size_t i = 0; i < rig.groups.size(); ++i) AppendGroup(rig.groups[i], i, &rig.sensors);
  rig.groups.clear();
  if (rig.sensors.empty()) {
    throw ConfigError("sensors = [] has no sensor; give at least one {name: A, phi_deg: 0}");
  }
  std::set<std::string> names;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const RigSensor& sensor = rig.sensors[i];
    const bool plain = std::all_of(sensor.name.begin(), sensor.name.end(), [](unsigned char c) {
      return std::isalnum(c) || c == '_' || c == '-';
    });
    if (sensor.name.empty() || sensor.name[0] == '-' || !plain) {
      throw ConfigError(fmt::format(
          "sensors[{}].name = \"{}\" is not made of letters, digits, _ and -, or begins with -", i,
          Shortened(sensor.name)));
    }
    if (!names.insert(sensor.name).second) {
      throw ConfigError(
          fmt::format("sensors[{}].name = {} stands twice; names are unique", i, sensor.name));
    }
    if (!sensor.image_size.empty()) ParseImageSize(sensor.image_size);
  }
  for (std::size_t k = 0; k < rig.placements.size(); ++k) {
    std::set<std::string> moved;
    for (const RigMovement& movement : rig.placements[k].moved) {
      if (names.count(movement.sensor) && moved.insert(movement.sensor).second) continue;
      throw ConfigError(fmt::format("placements[{}].moved: {}", k,
                                    names.count(movement.sensor)
                                        ? movement.sensor + " stands twice"
                                        : "there is no sensor \"" + movement.sensor + "\""));
    }
  }
  return rig;
}

std::vector<Intrinsics> IntrinsicsOf(const RigSensor& sensor,
                                     const std::vector<IntrinsicsPoolEntry>& pool,
                                     const std::string& pool_name) {
  constexpr int kWidestNative = 640;  // px; wider pictures are used at a quarter of their size
  const bool native = sensor.image_size.empty();
  const ImageSize size = native ? ImageSize{} : ParseImageSize(sensor.image_size);
  std::vector<Intrinsics> choices;
  for (const IntrinsicsPoolEntry& entry : pool) {
    if (entry.sensor != sensor.sensor) continue;
    for (const Intrinsics& intrinsics : entry.intrinsics) {
      const bool fits = native ? choices.empty() || (choices[0].width == intrinsics.width &&
                                                     choices[0].height == intrinsics.height)
                               : SameAspect(intrinsics, size);
      if (fits) choices.push_back(intrinsics);
    }
  }
  if (choices.empty()) {
    std::vector<std::string> names;
    for (const IntrinsicsPoolEntry& entry : pool) {
      if (std::find(names.begin(), names.end(), entry.sensor) == names.end())
        names.push_back(entry.sensor);
    }
    throw ConfigError(fmt::format("sensors: {}: {} has no intrinsics of {}{}, but of {}",
                                  sensor.name, pool_name, sensor.sensor,
                                  native ? "" : ", " + sensor.image_size, fmt::join(names, ", ")));
  }
  for (Intrinsics& choice : choices) {
    if (!native) {
      choice = choice.Resized(size.width, size.height);
    } else if (choice.width > kWidestNative) {
      choice = choice.Resized(choice.width / 4, choice.height / 4);
    }
  }
  return choices;
}

Pose RigSensorPose(const RigSensor& sensor, double structure_yaw_deg, double floor_height) {
  const double phi = sensor.phi_deg * M_PI / 180;
  const Eigen::Vector3d position(0.01 * sensor.rho_cm * std::cos(phi),
                                 floor_height + 0.01 * sensor.height_cm,
                                 0.01 * sensor.rho_cm * std::sin(phi));
  const Eigen::Vector3d target(0.01 * sensor.look_at_cm[0], 0.01 * sensor.look_at_cm[1],
                               0.01 * sensor.look_at_cm[2]);
  const Eigen::Vector3d level_target(target.x(), position.y(), target.z());
  const Pose structure_from_rig(
      Eigen::AngleAxisd(-structure_yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()));
  return structure_from_rig *
         LookAt(position, sensor.level ? level_target : target, sensor.roll_deg * M_PI / 180);
}

Pose FirstFromMoved(const RigMovement& movement) {
  const auto& [x, y, z] = movement.translation_mm;
  const auto& [about_x, about_y, about_z] = movement.rotation_deg;
  Pose first_from_moved(Pose::Identity());
  first_from_moved.linear() =
      RotationExp(Eigen::Vector3d(about_x, about_y, about_z) * (M_PI / 180));
  first_from_moved.translation() = 0.001 * Eigen::Vector3d(x, y, z);
  return first_from_moved;
}

Pose FirstFromPlacement(const RigPlacement& placement) {
  Pose first_from_placement(
      Eigen::AngleAxisd(placement.yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()));
  first_from_placement.translation() =
      Eigen::Vector3d(0.01 * placement.x_cm, 0, 0.01 * placement.z_cm);
  return first_from_placement;
}

void TurnStructure(double deg, Rig* rig) {
  rig->structure_yaw_deg = std::fmod(rig->structure_yaw_deg + deg, 360.0);
  const double cosine = std::cos(deg * M_PI / 180), sine = std::sin(deg * M_PI / 180);
  for (RigPlacement& placement : rig->placements) {
    const double x = placement.x_cm, z = placement.z_cm;
    placement.x_cm = cosine * x - sine * z;
    placement.z_cm = sine * x + cosine * z;
  }
}

std::vector<Rig> Turns(const Rig& rig) {
  std::vector<Rig> turns(std::max<std::size_t>(1, rig.turns_deg.size()), rig);
  for (std::size_t k = 0; k < turns.size(); ++k) {
    Rig& turn = turns[k];
    if (!rig.turns_deg.empty()) TurnStructure(rig.turns_deg[k], &turn);
    turn.turns_deg.clear();
    turn.seed += kTurnStride * k;
    DrawLookAt(&turn);
  }
  return turns;
}

}  // namespace volalign
