#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>

#include "core/geometry/pose.h"

namespace volalign {

/// Where an Azure Kinect's depth camera is in the frame of its colour camera, by the device's raw
/// calibration JSON: p_colour = T p_depth, metres, both x right, y down, z forward. Throws IoError
/// or DataError.
Pose ReadColourFromDepth(const std::filesystem::path& path);

namespace formats_internal {

enum class KinectCamera { kDepth, kColour };

/// That camera of a raw calibration (CalibrationInformation); throws DataError where it has none.
YAML::Node FindKinectCamera(const YAML::Node& root, KinectCamera camera, const std::string& name);

}  // namespace formats_internal

}  // namespace volalign
