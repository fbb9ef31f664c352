#include "infer/lens/sensor_kind.h"

#include <algorithm>

namespace volalign {

namespace {

/// Another of its kind. The focal length that goes without a distortion may be that of a pinhole
/// which fits the image best.
constexpr std::array<double, 3> kStrong = {0.01, 0.006, 0.01};
constexpr std::array<double, 3> kMild = {0.01, 0.03, 0.06};
constexpr std::array<double, 3> kRectified = {0.003, 0.006, 0.01};

}  // namespace

bool TypicalLens::rectified() const {
  return std::all_of(distortion.begin(), distortion.end(), [](double k) { return k == 0; });
}

const std::vector<SensorKind>& SensorKinds() {
  // A name that begins with several prefixes is of the first of them.
  static const std::vector<SensorKind> kinds = {
      // Microsoft's Azure-Kinect-Sensor-SDK, factory calibration in issue 1518.
      {"azure_kinect", DepthPrinciple::kTimeOfFlight,
       TypicalLens{{0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419}, kStrong}},
      // Public calibrations of the depth camera.
      {"kinect_v2", DepthPrinciple::kTimeOfFlight,
       TypicalLens{{0.09, -0.27, 0, 0, 0.10, 0, 0, 0}, kMild}},
      // Its depth images are rectified.
      {"realsense", DepthPrinciple::kStereo, TypicalLens{{}, kRectified}},
      {"kinect_v1", DepthPrinciple::kStereo, std::nullopt},
  };
  return kinds;
}

const SensorKind* FindSensorKind(const std::string& sensor) {
  const std::vector<SensorKind>& kinds = SensorKinds();
  const auto found = std::find_if(kinds.begin(), kinds.end(), [&](const SensorKind& kind) {
    return sensor.rfind(kind.prefix, 0) == 0;
  });
  return found == kinds.end() ? nullptr : &*found;
}

bool MeasuresBy(DepthPrinciple principle, const std::string& sensor) {
  const SensorKind* kind = FindSensorKind(sensor);
  return kind != nullptr && kind->principle == principle;
}

}  // namespace volalign
