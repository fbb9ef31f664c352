#include "infer/formats/kinect_calibration.h"

#include <fmt/format.h>

#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/config/bounded_yaml.h"
#include "infer/formats/poses/sensor_pose.h"

namespace volalign {

namespace {

using formats_internal::FindKinectCamera;
using formats_internal::KinectCamera;

/// "Rt" of a camera: the rotation row by row, and metres. Rt of every camera maps points of one
/// frame, which the cameras of a device share, into its own (extrinsic_transformation.c of the
/// Azure Kinect Sensor SDK).
Pose CameraFromDevice(const YAML::Node& camera, const std::string& name) {
  const YAML::Node rt = camera["Rt"];
  if (!rt || !rt["Rotation"] || !rt["Translation"]) {
    throw DataError(name +
                    ": a camera has no Rt, which says where it is in the device; give the whole "
                    "raw calibration, as the device or a recording's calibration.json has it");
  }
  const auto r = rt["Rotation"].as<std::vector<double>>();
  const auto t = rt["Translation"].as<std::vector<double>>();
  if (r.size() != 9 || t.size() != 3)
    throw DataError(
        fmt::format("{}: Rt has {} and {} numbers, not 9 and 3", name, r.size(), t.size()));
  return PoseFromRotation(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()),
                          Eigen::Map<const Eigen::Vector3d>(t.data()), name + ": Rt");
}

}  // namespace

namespace formats_internal {

YAML::Node FindKinectCamera(const YAML::Node& root, KinectCamera camera, const std::string& name) {
  const bool depth = camera == KinectCamera::kDepth;
  for (const YAML::Node& node : root["CalibrationInformation"]["Cameras"]) {
    const std::string purpose = node["Purpose"] ? node["Purpose"].as<std::string>() : "";
    const std::string location = node["Location"] ? node["Location"].as<std::string>() : "";
    if (purpose ==
            (depth ? "CALIBRATION_CameraPurposeDepth" : "CALIBRATION_CameraPurposePhotoVideo") ||
        location == (depth ? "CALIBRATION_CameraLocationD0" : "CALIBRATION_CameraLocationPV0"))
      return node;
  }
  throw DataError(fmt::format("{}: no camera of CalibrationInformation is the {} camera", name,
                              depth ? "depth" : "colour"));
}

}  // namespace formats_internal

Pose ReadColourFromDepth(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::string text = ReadFile(path, kMaxTextBytes);
  try {
    const YAML::Node root = LoadYaml(text);
    if (!root.IsMap() || !root["CalibrationInformation"]) {
      throw DataError(name +
                      ": no raw calibration of an Azure Kinect (a JSON file that begins with "
                      "CalibrationInformation)");
    }
    return CameraFromDevice(FindKinectCamera(root, KinectCamera::kColour, name), name) *
           CameraFromDevice(FindKinectCamera(root, KinectCamera::kDepth, name), name).inverse();
  } catch (const YAML::Exception& error) {
    throw DataError(fmt::format("{}: line {}: {}", name, error.mark.line + 1, error.msg));
  }
}

}  // namespace volalign
