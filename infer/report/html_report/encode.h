#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "infer/report/ply.h"

namespace volalign {

/// "data:image/png;base64,...", with a palette where 256 colours suffice.
std::string PngDataUri(const RgbImage& picture);

/// "#rrggbb"
std::string HexColour(Rgb colour);

/// A cloud in the page: little-endian bytes, in base64.
inline constexpr double kPointStep = 0.0005;      ///< m, of a coordinate, in 16 bits
inline constexpr double kResidualStep = 0.00025;  ///< m, of a residual, in 8 bits
inline constexpr int kNoResidual = -128;
struct EncodedCloud {
  std::size_t count = 0;
  std::string positions;  ///< x y z, int16 each, in steps of kPointStep
  std::string labels;     ///< uint8
  std::string residuals;  ///< int8, in steps of kResidualStep; kNoResidual for background
};
EncodedCloud EncodeCloud(const std::vector<AlignedPoint>& points);

/// Takes at most `most` of the points, evenly. Points with a label come first, up to six tenths.
std::vector<AlignedPoint> ThinCloud(const std::vector<AlignedPoint>& points, std::size_t most);

}  // namespace volalign
