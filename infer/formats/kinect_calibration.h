#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <optional>
#include <string>

#include "core/geometry/camera.h"
#include "infer/formats/intrinsics_file.h"

namespace volalign {

/// The colour camera of an Azure Kinect, by the device's raw calibration JSON. Its intrinsics are
/// for pictures of the size `picture`; without one they are left out. Throws DataError, with `name`
/// in its message.
ColourCamera ParseKinectColour(const std::string& text, const std::string& name,
                               const std::optional<FrameSize>& picture);
/// The same for a file, without intrinsics. Throws IoError or DataError.
ColourCamera ReadKinectColour(const std::filesystem::path& path);

namespace formats_internal {

enum class KinectCamera { kDepth, kColour };

/// The camera in a raw calibration (CalibrationInformation). Throws DataError if it has none.
YAML::Node FindKinectCamera(const YAML::Node& root, KinectCamera camera, const std::string& name);

/// A frame that is cut out of a chip, whole or binned, at (left, top), pixels.
struct KinectMode {
  int width, height, chip_width, chip_height, left, top;
};

/// The intrinsics of such frames, by a camera of a raw calibration. Throws DataError.
Intrinsics KinectIntrinsics(const YAML::Node& camera, const KinectMode& mode,
                            const std::string& name);

}  // namespace formats_internal

}  // namespace volalign
