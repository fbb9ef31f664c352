#pragma once

#include <string>

#include "core/geometry/camera.h"

namespace volalign {

struct ImageSize {
  int width = 0;
  int height = 0;
};

/// Parses WIDTHxHEIGHT, 16 to 4096 px each. Throws ConfigError.
ImageSize ParseImageSize(const std::string& text);

/// May intrinsics be scaled to an image of this size? Aspect ratios have to agree within 2 %.
bool SameAspect(const Intrinsics& intrinsics, ImageSize size);

}  // namespace volalign
