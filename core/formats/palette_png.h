#pragma once

#include <string>

#include "core/base/image.h"

namespace volalign {

/// A PNG with a palette, a third of the size of one without. A picture with over 256 colours has no
/// palette. Throws Error for an empty picture.
std::string EncodePalettePng(const RgbImage& picture);

}  // namespace volalign
