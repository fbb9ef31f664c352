#pragma once

#include <gtest/gtest.h>
#include <png.h>

#include <cstring>
#include <string>

#include "core/base/image.h"

namespace volalign {

/// Any PNG as RGB, palettes included, by libpng's simplified interface.
inline RgbImage DecodePngRgb(const std::string& bytes) {
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()));
  image.format = PNG_FORMAT_RGB;
  RgbImage picture(static_cast<int>(image.width), static_cast<int>(image.height));
  EXPECT_TRUE(png_image_finish_read(&image, nullptr, picture.data(), 0, nullptr));
  return picture;
}

}  // namespace volalign
