#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/config/config_word.h"
#include "core/geometry/depth_error_model.h"

namespace volalign {

enum class DepthPrinciple {
  kUnknown,
  kTimeOfFlight,
  kStereo  ///< matches patterns, of its own or of the scene's texture
};

constexpr Words<DepthPrinciple, 3> WordsOf(DepthPrinciple) {
  return {{{"unknown", DepthPrinciple::kUnknown},
           {"time_of_flight", DepthPrinciple::kTimeOfFlight},
           {"stereo", DepthPrinciple::kStereo}}};
}

/// A lens that is typical of a kind, in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6.
struct TypicalLens {
  std::vector<double> distortion;  ///< 8, or none of a rectified image
  /// By which those of a kind differ: standard deviations of the logarithm of the focal length, of
  /// k1 and of k2.
  std::array<double, 3> sigmas = {};
  /// By how much one device's focal length differs from what is said of it beyond what all of a
  /// rig have in common: standard deviation of its logarithm.
  double own_focal_sigma = 0;

  bool rectified() const { return distortion.empty(); }
};

/// What is known of a kind of sensor: an entry `kind` of configs/intrinsics.yaml, which the program
/// carries within itself.
struct SensorKind {
  std::string name;  ///< with which the names of its sensors begin
  DepthPrinciple principle = DepthPrinciple::kUnknown;
  std::optional<TypicalLens> lens;  ///< where it is known
  DepthErrorModel errors;
};

/// All that are known, but for `unknown`.
const std::vector<SensorKind>& SensorKinds();

/// The one that a name of the intrinsics pool (SensorFrame::sensor) belongs to, or null. Of several
/// whose names it begins with, that with the longest.
const SensorKind* FindSensorKind(const std::string& sensor);

/// Throws ConfigError, with all that are known, for a name that is of none; `what` begins it.
void RequireSensorKind(const std::string& sensor, const std::string& what);

/// Of the kind that a sensor is of; of a name that nothing knows, those of the entry `unknown`.
const DepthErrorModel& ErrorsOf(const std::string& sensor);

/// Whether it is known to measure in this way.
bool MeasuresBy(DepthPrinciple principle, const std::string& sensor);

/// Reads the entries `kind` of YAML like that of configs/intrinsics.yaml; `path` begins messages.
/// Throws ConfigError.
std::vector<SensorKind> ParseSensorKinds(const std::string& yaml, const std::string& path);

}  // namespace volalign
