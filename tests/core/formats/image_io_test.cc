#include "core/formats/image_io.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/random.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/read_png.h"
#include "tests/core/formats/write_pgm.h"

namespace volalign::image_io_test {
namespace {

// PNG files made with Python's zlib and struct modules, not with libpng.
// 3x2, 16-bit grey: 0 1 256 / 0x1234 65535 4000.
const char kGrey16[] =
    "89504e470d0a1a0a0000000d4948445200000003000000021000000000e88fe585000000164944415478da636060"
    "60606464601032f9ff9f7f0100094802f6aa593d310000000049454e44ae426082";
// 2x1, palette.
const char kPalette[] =
    "89504e470d0a1a0a0000000d4948445200000002000000010803000000c3fc8fb800000006504c54450102030405"
    "0695536f480000000b4944415478da6360600400000400022cde48ad0000000049454e44ae426082";
// 8x1, 1-bit grey.
const char kGrey1[] =
    "89504e470d0a1a0a0000000d4948445200000008000000010100000000cb7bd2ee0000000a4944415478da63580a"
    "0000a700a64831bf6f0000000049454e44ae426082";
// 1x1, 16-bit grey with alpha.
const char kGreyAlpha16[] =
    "89504e470d0a1a0a0000000d4948445200000001000000011004000000e58cd0410000000d4944415478da636064"
    "626601000019000b380454b40000000049454e44ae426082";
// Says 30000x30000 (1.8 GB) and holds 4 bytes.
const char kHuge[] =
    "89504e470d0a1a0a0000000d494844520000753000007530100000000013dc7b250000000d4944415478da636064"
    "626601000019000b380454b40000000049454e44ae426082";

std::string FromHex(const std::string& hex) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  return bytes;
}

class ImageIo : public testing::Test {
 protected:
  std::filesystem::path File(const std::string& bytes) { return folder_.Write("image", bytes); }
  void ExpectBadDepth(const std::string& bytes, const std::string& part) {
    SCOPED_TRACE(bytes.substr(0, 40));
    const auto path = File(bytes);
    ExpectError<DataError>([&] { ReadDepthFile(path); }, {path.string(), part});
  }

  TempFolder folder_;
};

template <class T>
Image<T> Noise(int width, int height, std::uint32_t maximum) {
  Image<T> image(width, height);
  RandomStream random(1, static_cast<std::uint64_t>(width), "image");
  for (auto& x : image)
    x = static_cast<T>(random.NextU32() % (static_cast<std::uint64_t>(maximum) + 1));
  return image;
}

RgbImage NoiseRgb(int width, int height) {
  RgbImage image(width, height);
  RandomStream random(2, 0, "image");
  for (auto& x : image) {
    const std::uint32_t word = random.NextU32();
    x = {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8),
         static_cast<std::uint8_t>(word >> 16)};
  }
  return image;
}

Image16 Expected(int width, int height, const std::vector<std::uint16_t>& values) {
  Image16 image(width, height);
  std::copy(values.begin(), values.end(), image.begin());
  return image;
}

TEST_F(ImageIo, ReadsAPngOfAnotherEncoder) {
  EXPECT_EQ(ReadDepthFile(File(FromHex(kGrey16))),
            Expected(3, 2, {0, 1, 256, 0x1234, 65535, 4000}));
}

TEST_F(ImageIo, PngRoundTrip) {
  for (const auto& [w, h] : {std::pair(1, 1), {7, 5}, {320, 288}}) {
    const auto path = folder_ / "a.png";
    const auto depth = Noise<std::uint16_t>(w, h, 65535);
    WritePng(path, depth);
    EXPECT_EQ(ReadDepthFile(path), depth);
    const auto labels = Noise<std::uint8_t>(w, h, 255);
    WritePng(path, labels);
    EXPECT_EQ(ReadPng8(path), labels);
    const RgbImage picture = NoiseRgb(w, h);
    WritePng(path, picture);
    EXPECT_EQ(DecodePngRgb(ReadFile(path, kMaxImageBytes)), picture);
  }
}

TEST_F(ImageIo, ReadsAsciiPgmWithComments) {
  EXPECT_EQ(ReadDepthFile(File("P2\n3 2\n4000\n0 1 2\n3 4 4000\n")),
            Expected(3, 2, {0, 1, 2, 3, 4, 4000}));
  EXPECT_EQ(ReadDepthFile(File("P2 # a comment\n# 9 9\n3# no\n 2\r\n#x\n4000 0\t1 2 3 4\n# in the "
                               "data 77\n\n4000")),
            Expected(3, 2, {0, 1, 2, 3, 4, 4000}));
}

TEST_F(ImageIo, ReadsBinaryPgmOf8And16Bits) {
  EXPECT_EQ(ReadDepthFile(File(std::string("P5 2 2 255\n\x00\x01\xff\x0a", 15))),
            Expected(2, 2, {0, 1, 255, 10}));
  EXPECT_EQ(ReadDepthFile(File(std::string("P5\n# made by hand\n2 1\n256\n\x01\x00\x00\xff", 30))),
            Expected(2, 1, {256, 255}));
  // Exactly one white space ends the header: a pixel may look like one.
  EXPECT_EQ(ReadDepthFile(File("P5 2 1 255 \n ")), Expected(2, 1, {'\n', ' '}));
}

TEST_F(ImageIo, RejectsBrokenPgm) {
  ExpectBadDepth("P2", "neither a PNG nor a PGM");
  ExpectBadDepth("P2\n", "truncated");
  ExpectBadDepth("P2\n3", "truncated");
  ExpectBadDepth("P2\n3 2\n", "truncated");
  ExpectBadDepth("P2\n3 2\n10\n", "truncated");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 4 5", "truncated");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 4 5 # 6", "truncated");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 4 5 11", "11 > maximum 10");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 x 5 6", "number");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 -4 5 6", "number");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 4.5 5 6", "number");
  ExpectBadDepth("P2\n3 2\n10\n1 2 3 99999999999999999999 5 6", "number");
  ExpectBadDepth("P2\n0 2\n10\n", "0x2");
  ExpectBadDepth("P2\n3 -2\n10\n", "number");
  ExpectBadDepth("P2\n3 2\n0\n0 0 0 0 0 0", "maximum 0");
  ExpectBadDepth("P2\n3 2\n65536\n0 0 0 0 0 0", "maximum 65536");
  ExpectBadDepth("P5 2 2 255\nabc", "truncated");
  ExpectBadDepth("P5 2 2 255", "truncated");
  ExpectBadDepth("P5 2 2 255# comment\nabcd", "white space");
  ExpectBadDepth("P5 2 2 65535\nabcdefg", "truncated");
  ExpectBadDepth(std::string("P5 2 1 100\n\x64\x65", 13), "101 > maximum 100");
  ExpectBadDepth(std::string("P5 1 1 1000\n\x03\xe9", 14), "1001 > maximum 1000");
  // A header that announces more than memory should be asked for.
  ExpectBadDepth("P5 32768 32768 65535\nabc", "truncated");
  ExpectBadDepth("P2 32768 32768 65535\n1 2 3", "truncated");
  ExpectBadDepth("P2 99999 1 65535\n1 2 3", "99999x1");
}

TEST_F(ImageIo, RejectsOtherKinds) {
  ExpectBadDepth("", "neither a PNG nor a PGM");
  ExpectBadDepth("\xff\xd8\xff\xe0 JFIF", "neither a PNG nor a PGM");
  ExpectBadDepth("P6\n1 1\n255\nabc", "neither a PNG nor a PGM");
  ExpectBadDepth("Pf\n1 1\n-1\nabcd", "neither a PNG nor a PGM");
  ExpectBadDepth(FromHex(kPalette), "palette");
  ExpectBadDepth(FromHex(kGrey1), "8 bits");
  ExpectBadDepth(FromHex(kGreyAlpha16), "2 channels");
  ExpectBadDepth(FromHex(kHuge), "truncated");

  const auto path = folder_ / "a.png";
  WritePng(path, LabelImage(3, 2));
  ExpectError<DataError>([&] { ReadDepthFile(path); }, {path.string(), "8 bits"});
  WritePng(path, Image16(3, 2));
  ExpectError<DataError>([&] { ReadPng8(path); }, {path.string(), "16 bits"});
  WritePng(path, RgbImage(3, 2));
  ExpectError<DataError>([&] { ReadDepthFile(path); }, {path.string(), "3 channels"});
  ExpectError<DataError>([&] { ReadPng8(path); }, {path.string(), "3 channels"});
  WritePgm(path, Image16(3, 2));
  ExpectError<DataError>([&] { ReadPng8(path); }, {path.string(), "PNG"});
  ExpectError<DataError>([&] { ReadPng8(File("")); });
}

// None of these may take the memory that it asks for.
TEST_F(ImageIo, EndlessAndHugeFilesAreRefused) {
  ExpectError<IoError>([] { ReadDepthFile("/dev/zero"); }, {"/dev/zero", "device"});
  ExpectError<IoError>([] { ReadPng8("/dev/zero"); }, {"/dev/zero", "device"});
  WriteFileAtomically(folder_ / "sparse.png", "");
  std::filesystem::resize_file(folder_ / "sparse.png", std::uintmax_t{1} << 40);
  ExpectError<IoError>([&] { ReadDepthFile(folder_ / "sparse.png"); }, {"sparse.png", "bytes"});
  std::string black = "P5\n9000 9000\n255\n";
  black.resize(black.size() + 81000000);
  WriteFileAtomically(folder_ / "black.pgm", black);
  ExpectError<DataError>([&] { ReadDepthFile(folder_ / "black.pgm"); }, {"9000x9000", "pixels"});
}

TEST_F(ImageIo, MissingFilesAndEmptyImages) {
  const auto missing = folder_ / "missing.png";
  ExpectError<IoError>([&] { ReadDepthFile(missing); }, {missing.string()});
  ExpectError<IoError>([&] { ReadPng8(missing); }, {missing.string()});
  ExpectError<Error>([&] { WritePng(missing, Image16()); }, {missing.string(), "empty"});
  ExpectError<Error>([&] { WritePng(missing, LabelImage(0, 3)); }, {missing.string(), "empty"});
  EXPECT_FALSE(std::filesystem::exists(missing));
}

TEST(DepthUnits, RoundTripOfEveryStep) {
  Image16 raw(256, 256);
  for (std::size_t i = 0; i < raw.size(); ++i) raw[i] = static_cast<std::uint16_t>(i);
  for (const double scale : {0.001, 0.0001, 0.00025}) {
    const DepthImage metres = ToMetres(raw, scale);
    EXPECT_EQ(metres[2000], static_cast<float>(2000 * scale));
    EXPECT_EQ(FromMetres(metres, scale), raw);
  }
}

TEST(DepthUnits, WhatDoesNotFitIsNoMeasurement) {
  DepthImage depth(7, 1);
  depth[0] = 65.535f;
  depth[1] = 65.536f;
  depth[2] = -1;
  depth[3] = std::numeric_limits<float>::quiet_NaN();
  depth[4] = std::numeric_limits<float>::infinity();
  depth[5] = 1.2344f;
  depth[6] = 1.2346f;
  const Image16 raw = FromMetres(depth, 0.001);
  EXPECT_EQ(std::vector<int>(raw.begin(), raw.end()),
            (std::vector<int>{65535, 0, 0, 0, 0, 1234, 1235}));
}

/// The colour type in a PNG's header: 3 is a palette, 2 is none.
int ColourType(const std::string& bytes) { return static_cast<unsigned char>(bytes.at(25)); }

TEST(PalettePng, IsReadAsItWas) {
  RgbImage few(37, 21);
  for (std::size_t i = 0; i < few.size(); ++i)
    few[i] = {static_cast<std::uint8_t>(i % 256), 7, static_cast<std::uint8_t>(i % 256 / 3)};
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
}  // namespace volalign::image_io_test
