#pragma once

#include <optional>
#include <string>

#include "infer/formats/intrinsics_file.h"

namespace volalign::formats_internal {

// Readers of the intrinsics that RealSense's and Orbbec's tools print for people. The result is
// empty for other texts. Throw DataError, which `name` begins, if the text is such a print but
// cannot be used.

/// print(profile.intrinsics) of pyrealsense2:
/// "[ 640x480  p[318.5 240.9]  f[383.3 383.3]  Brown Conrady [0 0 0 0 0] ]"
std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name);

/// `rs-enumerate-devices -c` prints blocks that begin `Intrinsic of "Depth" / 848x480 / {Z16}`.
/// Takes the one of the frame's size.
std::optional<Intrinsics> FromRsEnumerate(const std::string& text, const std::string& name,
                                          const FrameSize& frame);

/// The depth camera in pyorbbecsdk's print of OBCameraParam, whose lens is given as k1 ... k6 p1
/// p2.
std::optional<Intrinsics> FromPyorbbec(const std::string& text, const std::string& name);

}  // namespace volalign::formats_internal
