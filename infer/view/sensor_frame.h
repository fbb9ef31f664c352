#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/colour_camera.h"
#include "core/geometry/pose.h"
#include "infer/view/alike.h"

namespace volalign {

/// quarter_turns of a sensor whose mounting is to be found.
inline constexpr int kAutoTurns = -1;

/// One sensor's still frame in memory: all that calibration needs.
struct SensorFrame {
  std::string name;
  DepthImage depth;  ///< m, 0 where nothing was measured
  /// m: standard error of each depth, where it is the mean of several; empty where it is not known.
  Image<float> depth_sigma;
  Intrinsics intrinsics;
  bool typical_intrinsics = false;  ///< of the kind of device, not of this one
  /// Clockwise quarter turns that bring the image into the network's training orientation, or
  /// kAutoTurns.
  int quarter_turns = kAutoTurns;
  /// The kind of device, a name of the intrinsics pool: sensors of one kind have lenses alike.
  /// Empty or a name that nothing knows: a kind of which nothing is known.
  std::string sensor;
  std::optional<Pose> ground_truth;  ///< structure_from_sensor

  // Carried into extrinsics.json, not used.
  std::vector<std::string> depth_files;  ///< as the capture names them
  double depth_scale = kDepthStep;       ///< m per unit of the depth files
  std::string serial;
  std::string renderer;  ///< that drew the frame, where no sensor measured it
  std::optional<ColourCamera> colour;
};

/// What the sensors saw while the stack stood in one place.
struct Still {
  std::string name;  ///< of the capture, for a reader; unique
  std::vector<SensorFrame> frames;
};

}  // namespace volalign
