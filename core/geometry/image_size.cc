#include "core/geometry/image_size.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>

#include "core/base/error.h"

namespace volalign {

ImageSize ParseImageSize(const std::string& text) {
  ImageSize size;
  int used = 0;
  if (std::sscanf(text.c_str(), "%4dx%4d%n", &size.width, &size.height, &used) != 2 ||
      used != static_cast<int>(text.size()) || size.width < 16 || size.height < 16 ||
      size.width > 4096 || size.height > 4096) {
    throw ConfigError(fmt::format(
        "image size \"{}\" is not WIDTHxHEIGHT with 16 <= size <= 4096, such as 160x144", text));
  }
  return size;
}

bool SameAspect(const Intrinsics& intrinsics, ImageSize size) {
  constexpr double kTolerance = 0.02;
  const double pool = static_cast<double>(intrinsics.width) / intrinsics.height;
  const double image = static_cast<double>(size.width) / size.height;
  return std::abs(pool / image - 1) <= kTolerance;
}

}  // namespace volalign
