#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/camera.h"
#include "core/json/json_archive.h"

namespace volalign {

/// Reads the intrinsics of a frame of `frame` size. The file's content decides its form. JSON may
/// have volalign's keys (width, height, fx, fy, cx, cy, distortion) or be Open3D's pinhole
/// (intrinsic_matrix, column by column; alone or as "intrinsic"). YAML of OpenCV's FileStorage or
/// of ROS has camera_matrix or K, distortion_coefficients or D, and image_width, image_height or
/// width, height. Output of RealSense tools is JSON or YAML with ppx, ppy, coeffs, or the text of
/// pyrealsense2's `intrinsics`. It may also be the text of `rs-enumerate-devices -c`, of which the
/// depth stream of `frame` size is taken, or pyorbbecsdk's print of OBCameraParam. The raw
/// calibration JSON of an Azure Kinect (CalibrationInformation) has shares of the whole chip, and
/// `frame` decides which of its four modes is meant.
///
/// The others give the size that they were made for, and it is not changed. Lens models that are
/// not OpenCV's with 0, 4, 5 or 8 coefficients are errors. Throws IoError or DataError.
Intrinsics ReadIntrinsicsFile(const std::filesystem::path& path, const ImageSize& frame);

/// The same for a text; `name` begins every message.
Intrinsics ParseIntrinsicsText(const std::string& text, const std::string& name,
                               const ImageSize& frame);

/// Says why no reader takes the text and what to do: it is UTF-16, XML or binary. Empty otherwise.
std::string WhyNoText(const std::string& text);

/// Does a text look like one of these, so that ParseIntrinsicsText can comment on it?
bool LooksLikeIntrinsics(const std::string& text);

}  // namespace volalign

namespace volalign::formats_internal {

/// The coefficients, in OpenCV's order and at most eight, of a lens with the name `model` of ROS or
/// RealSense; "" is OpenCV's own. A lens without any effect may have any name. Throws DataError,
/// which `name` begins, for other models, and for more than eight coefficients unless the rest is
/// 0.
std::vector<double> NamedLens(const std::string& model, std::vector<double> numbers,
                              const std::string& name);

}  // namespace volalign::formats_internal
