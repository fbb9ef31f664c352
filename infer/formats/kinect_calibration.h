#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "core/config/archive.h"
#include "core/geometry/camera.h"
#include "infer/formats/intrinsics_file.h"

namespace volalign {

/// The colour camera of an Azure Kinect, by the device's raw calibration JSON. Its intrinsics are
/// for pictures of the size `picture`; without one they are left out. Throws DataError, with `name`
/// in its message.
ColourCamera ParseKinectColour(const std::string& text, const std::string& name,
                               const std::optional<ImageSize>& picture);
/// The same for a file, without intrinsics. Throws IoError or DataError.
ColourCamera ReadKinectColour(const std::filesystem::path& path);

namespace formats_internal {

/// The name in configs/intrinsics.yaml of the mode with depth frames of a size, or "".
std::string KinectKind(const ImageSize& frame);

/// The intrinsics of depth frames of a size, by a raw calibration (with CalibrationInformation), of
/// which the size names the mode. Throws DataError.
Intrinsics KinectDepthIntrinsics(const ObjectReader& calibration, const ImageSize& frame);

}  // namespace formats_internal

}  // namespace volalign
