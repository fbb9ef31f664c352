#pragma once

#include <array>
#include <string>
#include <vector>

#include "core/config.h"

namespace volalign {

/// Paper, Results "Implementation details"; design section 4.
struct PoseConfig {
  std::array<double, 2> rho_cm{150, 275};
  std::array<double, 2> height_cm{-15, 75};
  double look_at_radius_cm = 20;
  double roll_deg = 5;
  std::vector<double> roll_offsets_deg{90};

  template <class Archive>
  void Describe(Archive& ar) {
    ar("rho_cm", rho_cm, "horizontal distance of the sensor from the origin, cm, uniform",
       Above(0));
    ar("height_cm", height_cm, "height of the sensor above the origin, cm, uniform");
    ar("look_at_radius_cm", look_at_radius_cm, "radius of the ball of look-at points, cm",
       AtLeast(0));
    ar("roll_deg", roll_deg, "largest roll about the levelled optical axis, deg, uniform",
       AtLeast(0));
    ar("roll_offsets_deg", roll_offsets_deg,
       "mounting rolls, deg, one drawn for each sample; 90 turns image +x to the floor");
  }
};

/// What stands around the structure, and whether it is there at all.
struct SceneConfig {
  double structure_probability = 1.0;
  double room_probability = 1.0;
  std::array<double, 2> wall_distance_m{2.5, 5.5};
  double ceiling_probability = 0.5;
  std::array<double, 2> ceiling_height_m{2.4, 3.2};
  std::array<int, 2> clutter_count{0, 14};
  std::array<double, 2> clutter_size_m{0.1, 1.4};
  double clutter_clearance_m = 0.05;
  double distractor_probability = 0.3;
  double occluder_probability = 0.15;
  std::array<int, 2> tripod_count{0, 7};
  std::array<double, 2> tripod_distance_m{2.0, 4.5};
  double dark_probability = 0.15;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("structure_probability", structure_probability,
       "share of samples with the structure; the others are all background", Between(0, 1));
    ar("room_probability", room_probability, "share of samples with floor and walls",
       Between(0, 1));
    ar("wall_distance_m", wall_distance_m, "distance of each of four walls from the origin, m",
       Above(0));
    ar("ceiling_probability", ceiling_probability, "share of rooms with a ceiling", Between(0, 1));
    ar("ceiling_height_m", ceiling_height_m, "ceiling height above the floor, m", Above(0));
    ar("clutter_count", clutter_count,
       "number of furniture-like objects (boxes, cylinders, spheres)", AtLeast(0));
    ar("clutter_size_m", clutter_size_m, "largest extent of an object, m", Above(0));
    ar("clutter_clearance_m", clutter_clearance_m, "least gap between clutter and structure, m",
       AtLeast(0));
    ar("distractor_probability", distractor_probability,
       "share of scenes with boxes like the structure's standing near it", Between(0, 1));
    ar("occluder_probability", occluder_probability,
       "share of scenes with an object between sensor and structure", Between(0, 1));
    ar("tripod_count", tripod_count, "number of other sensors on tripods", AtLeast(0));
    ar("tripod_distance_m", tripod_distance_m, "horizontal distance of a tripod from the origin, m",
       Above(0));
    ar("dark_probability", dark_probability,
       "share of objects that return almost no infrared light", Between(0, 1));
  }
};

/// How well the structure was put together. Labels and poses refer to the nominal structure.
struct AssemblyConfig {
  double position_mm = 3;
  double yaw_deg = 0.5;
  double size_scale_percent = 1;
  double floor_tilt_deg = 0.5;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("position_mm", position_mm,
       "standard deviation of a box's horizontal place, mm along each axis", AtLeast(0));
    ar("yaw_deg", yaw_deg, "standard deviation of a box's turn about the vertical, deg",
       AtLeast(0));
    ar("size_scale_percent", size_scale_percent,
       "standard deviation of the size error that all boxes share, percent", Between(0, 20));
    ar("floor_tilt_deg", floor_tilt_deg,
       "standard deviation of the room's tilt against the structure about each horizontal axis, "
       "deg",
       Between(0, 10));
  }
};

/// How the depth map is spoilt.
struct NoiseConfig {
  std::string model = "sensor";
  double paper_border_px = 2;
  double paper_hole_count = 6;
  double paper_hole_radius_px = 6;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("model", model,
       "none, paper (zeroed borders and holes, paper's Results) or sensor (models of the drawn "
       "sensor)",
       OneOf({"none", "paper", "sensor"}));
    ar("paper_border_px", paper_border_px, "largest width of the zeroed structure border, px",
       AtLeast(0));
    ar("paper_hole_count", paper_hole_count, "mean number of holes in a sample", AtLeast(0));
    ar("paper_hole_radius_px", paper_hole_radius_px, "mean radius of a hole, px", AtLeast(0));
  }
};

/// Everything that a sample depends on but seed and index.
struct SampleConfig {
  std::string structure = "configs/structure.yaml";
  std::string intrinsics = "configs/intrinsics.yaml";
  std::vector<std::string> sensors{"realsense_d415", "azure_kinect_nfov_binned"};
  std::vector<std::string> image_sizes{"160x144"};
  PoseConfig pose;
  SceneConfig scene;
  AssemblyConfig assembly;
  NoiseConfig noise;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("structure", structure, "structure file, .yaml or .glb");
    ar("intrinsics", intrinsics, "pool of measured intrinsics");
    ar("sensors", sensors, "sensors drawn from the pool; all of them when empty");
    ar("image_sizes", image_sizes,
       "WIDTHxHEIGHT, one drawn for each batch; intrinsics are scaled to it");
    ar("pose", pose, "sensor pose sampling");
    ar("scene", scene, "procedural room");
    ar("assembly", assembly, "imprecise placement of the structure's boxes; 0 is the exact model");
    ar("noise", noise, "sensor noise");
  }
};

}  // namespace volalign
