#include "core/palette_png.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cstring>
#include <string>

#include "core/error.h"
#include "tests/core/expect_error.h"

namespace volalign {
namespace {

/// Decoded by libpng's simplified interface.
RgbImage Decode(const std::string& bytes) {
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()));
  image.format = PNG_FORMAT_RGB;
  RgbImage picture(static_cast<int>(image.width), static_cast<int>(image.height));
  EXPECT_TRUE(png_image_finish_read(&image, nullptr, picture.data(), 0, nullptr));
  return picture;
}

/// The colour type in a PNG's header: 3 is a palette, 2 is none.
int ColourType(const std::string& bytes) { return static_cast<unsigned char>(bytes.at(25)); }

TEST(PalettePng, IsReadAsItWas) {
  RgbImage few(37, 21);
  for (std::size_t i = 0; i < few.size(); ++i) {
    few[i] = {static_cast<std::uint8_t>(i % 256), 7, static_cast<std::uint8_t>(i % 256 / 3)};
  }
  const std::string with = EncodePalettePng(few);
  EXPECT_EQ(ColourType(with), 3);
  EXPECT_EQ(Decode(with), few);

  RgbImage many = few;
  many(36, 20) = {1, 2, 3};  // the 257th colour
  const std::string without = EncodePalettePng(many);
  EXPECT_EQ(ColourType(without), 2);
  EXPECT_EQ(Decode(without), many);
}

TEST(PalettePng, AnEmptyPictureIsAnError) {
  ExpectError<Error>([] { EncodePalettePng(RgbImage()); }, {"empty"});
}

}  // namespace
}  // namespace volalign
