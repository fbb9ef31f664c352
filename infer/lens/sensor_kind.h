#pragma once

// What calibration knows of a kind of sensor; what the renderer knows of it is in render/noise.cc.

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace volalign {

enum class DepthPrinciple {
  kTimeOfFlight,
  kStereo  ///< matches patterns, of its own or of the scene's texture
};

/// A lens that is typical of a kind, in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6.
struct TypicalLens {
  std::array<double, 8> distortion;
  /// By which those of a kind differ: standard deviations of the logarithm of the focal length, of
  /// k1 and of k2.
  std::array<double, 3> sigmas;

  bool rectified() const;  ///< all coefficients are 0
};

struct SensorKind {
  const char* prefix;  ///< of its names in the intrinsics pool
  DepthPrinciple principle;
  std::optional<TypicalLens> lens;  ///< where it is known
};

/// All that are known.
const std::vector<SensorKind>& SensorKinds();

/// The one that a name of the intrinsics pool (SensorFrame::sensor) belongs to, or null.
const SensorKind* FindSensorKind(const std::string& sensor);

/// Whether it is known to measure in this way.
bool MeasuresBy(DepthPrinciple principle, const std::string& sensor);

}  // namespace volalign
