#pragma once

#include <string>

#include "core/base/image.h"

namespace volalign {

/// A PNG with a palette, a third of the size of one without; of a picture with over 256 colours,
/// one without. Throws Error for an empty picture.
std::string EncodePalettePng(const RgbImage& picture);

}  // namespace volalign
