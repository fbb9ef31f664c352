#pragma once

#include <array>
#include <string>
#include <vector>

#include "core/config/config.h"

namespace volalign {

/// Noise models by their names in recipes and rigs. RegisterNoiseModel (render/noise.h) adds to
/// them at the start of a program, before other threads run.
inline std::vector<std::string>& NoiseModelNames() {
  static std::vector<std::string> names{"none", "paper", "sensor", "physics"};
  return names;
}

/// The surroundings of the structure.
struct SceneConfig {
  std::array<double, 2> wall_distance_m{2.5, 5.5};
  std::array<int, 2> clutter_count{0, 14};
  double distractor_probability = 0.3;
  double occluder_probability = 0.15;
  std::array<int, 2> tripod_count{0, 7};
  // These have no keys.
  double ceiling_probability = 0.5;  ///< share of rooms with a ceiling
  std::array<double, 2> ceiling_height_m{2.4, 3.2};
  std::array<double, 2> clutter_size_m{0.1, 1.4};     ///< largest extent of an object
  double clutter_clearance_m = 0.05;                  ///< least gap between clutter and structure
  std::array<double, 2> tripod_distance_m{2.0, 4.5};  ///< horizontal, from the origin
  double dark_probability = 0.15;  ///< share of objects that return almost no infrared light

  template <class Archive>
  void Describe(Archive& ar) {
    const char* const fixed = "it has one value for all scenes; leave the key out";
    using Harmless = std::vector<std::string>;
    ar("wall_distance_m", wall_distance_m, "distance of each of four walls from the origin, m",
       Above(0), Removed("ceiling_probability", fixed, Harmless{"0.5"}),
       Removed("ceiling_height_m", fixed, Harmless{"2.4", "3.2"}));
    ar("clutter_count", clutter_count,
       "number of furniture-like objects (boxes, cylinders, spheres)", AtLeast(0),
       Removed("clutter_size_m", fixed, Harmless{"0.1", "1.4"}),
       Removed("clutter_clearance_m", fixed, Harmless{"0.05"}),
       Removed("dark_probability", fixed, Harmless{"0.15"}));
    ar("distractor_probability", distractor_probability,
       "share of scenes with boxes like the structure's standing near it", Between(0, 1));
    ar("occluder_probability", occluder_probability,
       "share of scenes with an object between sensor and structure", Between(0, 1));
    ar("tripod_count", tripod_count, "number of other sensors on tripods", AtLeast(0),
       Removed("tripod_distance_m", fixed, Harmless{"2", "4.5"}));
  }
};

/// How precisely the structure was built. Labels and poses refer to the nominal structure.
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

}  // namespace volalign
