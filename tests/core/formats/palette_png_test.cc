#include "core/formats/palette_png.h"

#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/formats/read_png.h"

namespace volalign::palette_png_test {
namespace {

/// The colour type in a PNG's header: 3 is a palette, 2 is none.
int ColourType(const std::string& bytes) { return static_cast<unsigned char>(bytes.at(25)); }

TEST(PalettePng, IsReadAsItWas) {
  RgbImage few(37, 21);
  for (std::size_t i = 0; i < few.size(); ++i) {
    few[i] = {static_cast<std::uint8_t>(i % 256), 7, static_cast<std::uint8_t>(i % 256 / 3)};
  }
  const std::string with = EncodePalettePng(few);
  EXPECT_EQ(ColourType(with), 3);
  EXPECT_EQ(DecodePngRgb(with), few);

  RgbImage many = few;
  many(36, 20) = {1, 2, 3};  // the 257th colour
  const std::string without = EncodePalettePng(many);
  EXPECT_EQ(ColourType(without), 2);
  EXPECT_EQ(DecodePngRgb(without), many);
}

TEST(PalettePng, AnEmptyPictureIsAnError) {
  ExpectError<Error>([] { EncodePalettePng(RgbImage()); }, {"empty"});
}

}  // namespace
}  // namespace volalign::palette_png_test
