#pragma once

#include <optional>
#include <string>

#include "infer/formats/intrinsics_file.h"

namespace volalign::formats_internal {

// What RealSense's tools print for people. None where the text is not that; DataError, which `name`
// begins, where it is and cannot be used.

/// print(profile.intrinsics) of pyrealsense2:
/// "[ 640x480  p[318.5 240.9]  f[383.3 383.3]  Brown Conrady [0 0 0 0 0] ]"
std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name);

/// `rs-enumerate-devices -c`, blocks that begin `Intrinsic of "Depth" / 848x480 / {Z16}`: that of
/// the frame's size.
std::optional<Intrinsics> FromRsEnumerate(const std::string& text, const std::string& name,
                                          const FrameSize& frame);

/// Of the depth camera in pyorbbecsdk's print of OBCameraParam, whose lens is given as k1 ... k6 p1
/// p2. Nothing for other texts.
std::optional<Intrinsics> FromPyorbbec(const std::string& text, const std::string& name);

}  // namespace volalign::formats_internal
