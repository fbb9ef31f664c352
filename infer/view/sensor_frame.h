#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "infer/view/alike.h"
#include "infer/view/pose_prior.h"

namespace volalign {

/// quarter_turns of a sensor whose mounting is unknown.
inline constexpr int kAutoTurns = -1;

/// One sensor's frame in memory: all that calibration needs.
struct SensorFrame {
  std::string name;
  DepthImage depth;  ///< m, 0 where nothing was measured
  /// m: standard error of each depth, if it is the mean of several; empty if unknown.
  Image<float> depth_sigma;
  Intrinsics intrinsics;
  bool typical_intrinsics = false;  ///< of the kind of device, not of this one
  /// Clockwise quarter turns that bring the image into the network's training orientation, or
  /// kAutoTurns.
  int quarter_turns = kAutoTurns;
  /// The kind of device, a name of the intrinsics pool. Sensors of one kind have similar lenses.
  /// Empty or an unknown name: an unknown kind.
  std::string sensor;
  std::optional<PosePrior> prior;    ///< of its pose
  std::optional<Pose> ground_truth;  ///< structure_from_sensor

  // Copied to extrinsics.json, not used.
  std::vector<std::string> depth_files;  ///< as the capture names them
  double depth_scale = kDepthStep;       ///< m per unit of the depth files
  std::string serial;
  std::string renderer;  ///< program that drew the frame, if no sensor measured it
  std::optional<ColourCamera> colour;
};

/// A capture: the frames of the sensors while the stack stood in one place.
struct Capture {
  std::string name;  ///< of the capture, for a reader; unique
  std::vector<SensorFrame> frames;
};

}  // namespace volalign
