#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/depth_error_model.h"

namespace volalign {

/// A typical lens of a kind, in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6.
struct TypicalLens {
  std::vector<double> distortion;  ///< 8, or none for a rectified image
  /// Spread within the kind: standard deviations of the logarithm of the focal length, of k1 and of
  /// k2.
  std::array<double, 3> sigmas = {};
  /// Standard deviation of the logarithm of one device's own factor on the focal length, beyond the
  /// common error of all devices in a rig.
  double own_focal_sigma = 0;

  bool rectified() const { return distortion.empty(); }
};

/// A kind of sensor: an entry `kind` of configs/intrinsics.yaml, which the program contains.
struct SensorKind {
  std::string name;                 ///< beginning of its sensors' names
  std::optional<TypicalLens> lens;  ///< if known
  DepthErrorModel errors;
};

/// All known kinds, without `unknown`.
const std::vector<SensorKind>& SensorKinds();

/// The kind of a name of the intrinsics pool (SensorFrame::sensor), or null. The name begins with
/// the kind's name; the longest such name counts.
const SensorKind* FindSensorKind(const std::string& sensor);

/// Throws ConfigError, which begins with `what` and has all known kinds, for a name without a kind.
void RequireSensorKind(const std::string& sensor, const std::string& what);

/// The errors of a sensor's kind; those of the entry `unknown` for a name without a kind.
const DepthErrorModel& ErrorsOf(const std::string& sensor);

/// Reads the entries `kind` of YAML like configs/intrinsics.yaml; `path` begins messages. Throws
/// ConfigError.
std::vector<SensorKind> ParseSensorKinds(const std::string& yaml, const std::string& path);

}  // namespace volalign
