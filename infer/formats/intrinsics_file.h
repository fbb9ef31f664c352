#pragma once

#include <filesystem>
#include <string>

#include "core/geometry/camera.h"
#include "core/json/strict_json.h"

namespace volalign {

/// Width and height of the frame that intrinsics are wanted for.
struct FrameSize {
  int width = 0, height = 0;
};

/// Reads the intrinsics of a frame of `frame` size. By its content, the file is
/// - JSON with volalign's keys (width, height, fx, fy, cx, cy, distortion),
/// - Open3D's pinhole JSON (intrinsic_matrix, column by column; alone or as "intrinsic"),
/// - YAML of OpenCV's FileStorage or of ROS (camera_matrix or K, distortion_coefficients or D, and
///   image_width, image_height or width, height),
/// - what RealSense tools print: JSON or YAML with ppx, ppy, coeffs; the text of pyrealsense2's
///   `intrinsics`; the text of `rs-enumerate-devices -c`, of which the depth stream of `frame` size
///   is taken, or
/// - the raw calibration JSON of an Azure Kinect (CalibrationInformation), whose numbers are shares
///   of the whole chip: `frame` says which of its four modes they are wanted for.
/// The others give the size that they were made for, and it is not changed. Lens models that are
/// not OpenCV's with 0, 4, 5 or 8 coefficients are errors. Throws IoError or DataError.
Intrinsics ReadIntrinsicsFile(const std::filesystem::path& path, const FrameSize& frame);

/// The same of a text; `name` begins every message.
Intrinsics ParseIntrinsicsText(const std::string& text, const std::string& name,
                               const FrameSize& frame);

/// Why no reader takes the text, whatever it says, and what to do: it is UTF-16, XML or binary.
/// Empty otherwise.
std::string WhyNoText(const std::string& text);

/// Whether a text looks like one of these, so that ParseIntrinsicsText has something to say of it.
bool LooksLikeIntrinsics(const std::string& text);

}  // namespace volalign
