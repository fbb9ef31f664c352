#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/scene_config.h"

namespace volalign {

/// The common keys of a group of sensors and of a single sensor.
struct RigMount {
  std::string sensor = "realsense_d415";
  double rho_cm = 200;
  double roll_deg = 90;
  std::array<double, 3> look_at_cm{0, 0, 0};
  double look_at_radius_cm = 0;
  bool level = false;
  std::string image_size;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("sensor", sensor, "name in the intrinsics pool; it also chooses the noise model");
    ar("rho_cm", rho_cm, "horizontal distance from the rig's centre, cm", Above(0));
    ar("roll_deg", roll_deg, "mounting roll, deg; 90 turns image +x to the floor");
    ar("look_at_cm", look_at_cm, "point at which the sensor looks, rig frame, cm");
    ar("look_at_radius_cm", look_at_radius_cm,
       "radius of the ball around look_at_cm in which each turn draws the point that is looked at, "
       "cm",
       AtLeast(0));
    ar("level", level, "the optical axis is level: look_at_cm counts without its height");
    ar("image_size", image_size,
       "WIDTHxHEIGHT; empty: the pool's own size, a quarter of it where that is wider than 640");
  }
};

/// One sensor of a rig. The rig's frame is the structure's at structure_yaw_deg = 0. The position
/// is (rho cos phi, floor + height, rho sin phi).
struct RigSensor : RigMount {
  std::string name;
  double phi_deg = 0;
  double height_cm = 100;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "unique; names the files");
    ar("phi_deg", phi_deg, "angle about the vertical from +x towards +z, deg");
    ar("height_cm", height_cm, "height above the floor, cm", Above(0));
    RigMount::Describe(ar);
  }
};

/// A sensor that was moved after the first capture. Its pose is its first one times this movement,
/// about its own axes (x right, y down, z forward).
struct RigMovement {
  std::string sensor;
  std::array<double, 3> translation_mm{0, 0, 0};
  std::array<double, 3> rotation_deg{0, 0, 0};

  template <class Archive>
  void Describe(Archive& ar) {
    ar("sensor", sensor, "name of the sensor");
    ar("translation_mm", translation_mm, "movement of the sensor along its own axes, mm");
    ar("rotation_deg", rotation_deg,
       "rotation of the sensor, a rotation vector in its own axes, deg");
  }
};

/// Sensors that differ only in angle and height: a ring, an arc, or a column.
struct RigGroup : RigMount {
  std::string name = "S";
  std::vector<double> phi_deg{0};
  std::vector<double> height_cm{100};

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name,
       "first part of the sensors' names, followed by numbers from 1 on: S1, S2, ...");
    ar("phi_deg", phi_deg,
       "angles of the sensors, deg. There are as many sensors as the longer list of phi_deg and "
       "height_cm has elements; the shorter list is repeated");
    ar("height_cm", height_cm, "heights of the sensors above the floor, cm", Above(0));
    RigMount::Describe(ar);
  }
};

/// A further place of the structure: the pose of its frame in the frame of its first place.
struct RigPlacement {
  double x_cm = 0;
  double z_cm = 0;
  double yaw_deg = 0;
  std::vector<RigMovement> moved;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("x_cm", x_cm, "where the structure's origin stands, in the frame of its first place, cm");
    ar("z_cm", z_cm, "like x_cm, along z");
    ar("yaw_deg", yaw_deg, "turn about the vertical, deg, positive from +z towards +x");
    ar("moved", moved, "sensors that somebody moved before this capture, from their first poses");
  }
};

/// A sensor's device errors (bias, warp and all else that one device does alike in all frames) in
/// the captures of several placements. Either they persist, or each capture draws its own.
enum class DeviceErrorDraw { kPersistent, kRedrawn };
constexpr Words<DeviceErrorDraw, 2> WordsOf(DeviceErrorDraw) {
  return {{{"persistent", DeviceErrorDraw::kPersistent}, {"redrawn", DeviceErrorDraw::kRedrawn}}};
}

/// The description of a simulated multi-sensor capture, rig.yaml; render/rig.h draws it.
struct Rig {
  Rig() {
    scene.clutter_count = {6, 20};
    scene.tripod_count = {0, 0};
    scene.occluder_probability = 0;
    assembly = {0, 0, 0, 0};
  }

  std::string structure = "configs/structure.yaml";
  std::string intrinsics = "configs/intrinsics.yaml";
  double structure_yaw_deg = 0;
  std::vector<double> turns_deg;  ///< one capture each, see Turns
  bool structure_present = true;
  bool room = true;
  bool tripods = true;
  std::vector<std::string> noise{"sensor"};
  bool state_lens = true;
  double lens_spread_percent = 0;
  double hidden_share = 0;
  double missing_share = 0;
  std::uint64_t seed = 1;
  std::vector<RigSensor> sensors;
  std::vector<RigGroup> groups;          ///< ReadRig makes sensors of them
  std::vector<RigPlacement> placements;  ///< after the first, which is the identity
  DeviceErrorDraw device_errors = DeviceErrorDraw::kPersistent;
  SceneConfig scene;
  AssemblyConfig assembly;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("structure", structure, "structure file: .yaml, or a mesh (.glb, .gltf, .obj, .stl, .ply)");
    ar("intrinsics", intrinsics, "pool of measured intrinsics");
    ar("structure_yaw_deg", structure_yaw_deg,
       "turn of the structure about the vertical in the rig, deg; positive from +z towards +x, "
       "against the sense of phi_deg");
    ar("turns_deg", turns_deg,
       "captures to make: in each, the structure is turned by one of these angles beyond "
       "structure_yaw_deg, deg. Each draws room, assembly and noise anew (from seed, seed + "
       "1000000, ...). Empty: one capture");
    ar("structure_present", structure_present, "false: the room alone, to test failure");
    ar("room", room, "false: nothing but the structure");
    ar("tripods", tripods, "draw the other sensors and their tripods (with room only)");
    ar("noise", noise,
       "one or a list of none, paper, sensor and physics (docs/sensor-models.md), as "
       "data.noise.models of a recipe, applied in this order; your program can register others",
       OneOf(NoiseModelNames()));
    ar("state_lens", state_lens,
       "true: the capture states the lens of the intrinsics pool. false: frames are drawn through "
       "it, but the capture leaves it out");
    ar("lens_spread_percent", lens_spread_percent,
       "standard deviation of a sensor's true lens from the stated one, %. It holds for the focal "
       "length, and for the radial factor at r = 0.6 on the plane z = 1",
       Between(0, 5));
    ar("hidden_share", hidden_share,
       "share of each sensor's view of the structure that a board 0.7 m before it hides. The seed "
       "draws whether it comes from the left, the right or below",
       Between(0, 1));
    ar("missing_share", missing_share,
       "share of all pixels that lose their depth independently, besides those that noise removes",
       Between(0, 1));
    ar("seed", seed, "seed of room, clutter, assembly, intrinsics and noise", AtLeast(0));
    ar("sensors", sensors, "the sensors");
    ar("groups", groups,
       "further sensors, alike but for angle and height: a ring, an arc, a column");
    ar("placements", placements,
       "further places of the structure, one capture each: sensors and room stay, the structure is "
       "built again there, out of place by draws of its own, of the same size");
    ar("device_errors", device_errors,
       "persistent or redrawn. Persistent errors of a device, such as bias and warp, are the same "
       "in all placements. Redrawn errors differ, and average out as real ones do not");
    ar("scene", scene, "the room's content");
    ar("assembly", assembly,
       "how imprecisely the structure's boxes are stacked; 0 is the exact model");
  }
};

/// Reads and checks a rig: at least one sensor, unique names that are fit for file names, and
/// movements of its own sensors only. Sensors of `groups` stand behind those of `sensors`; the
/// result has no groups. Throws ConfigError.
Rig ReadRig(const ConfigSource& source);

/// The pool's intrinsics for a sensor, at the size of its image; not empty. Throws ConfigError for
/// a sensor that the pool (named `pool_name`) lacks, or an image size of another aspect ratio.
std::vector<Intrinsics> IntrinsicsOf(const RigSensor& sensor,
                                     const std::vector<IntrinsicsPoolEntry>& pool,
                                     const std::string& pool_name);

/// The sensor's pose in the structure frame, for a structure whose floor is at `floor_height`.
Pose RigSensorPose(const RigSensor& sensor, double structure_yaw_deg, double floor_height);

/// first_from_moved: the sensor's frame after the movement in its frame of the first capture.
Pose FirstFromMoved(const RigMovement& movement);

/// The structure's frame at a placement in that of its first place, for a level floor.
Pose FirstFromPlacement(const RigPlacement& placement);

/// Turns the structure about its own vertical wherever it stands. structure_yaw_deg grows by `deg`,
/// modulo 360, and the placements keep their places among the sensors.
void TurnStructure(double deg, Rig* rig);

/// The captures of a rig, one per turn, in order; one if it has no turns. Each has its own seed, no
/// turns, and look-at points that are drawn.
std::vector<Rig> Turns(const Rig& rig);

}  // namespace volalign
