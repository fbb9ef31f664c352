// Depth files as others write them: TIFF and OpenEXR by OpenCV, NPY by NumPy's published layout.

#include "infer/formats/depth_file.h"

#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfOutputFile.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <tiffio.h>
#include <unistd.h>

#include <cmath>
#include <cstdarg>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/write_pgm.h"

namespace volalign::depth_file_test {
namespace {

constexpr int kWidth = 7, kHeight = 5;

class DepthFileTest : public ::testing::Test {
 protected:
  /// The value that every test writes at (u, v).
  static double Value(int u, int v) { return 1000 + 10 * v + u; }

  static cv::Mat Filled(int type, double factor = 1) {
    cv::Mat mat(kHeight, kWidth, CV_64F);
    for (const auto [u, v] : Pixels(kWidth, kHeight)) mat.at<double>(v, u) = factor * Value(u, v);
    mat.convertTo(mat, type);
    return mat;
  }

  void ExpectFilled(const std::filesystem::path& path, bool whole_numbers, double factor = 1) {
    const StoredDepth depth = ReadStoredDepth(path);
    ASSERT_EQ(depth.values.width(), kWidth);
    ASSERT_EQ(depth.values.height(), kHeight);
    EXPECT_EQ(depth.whole_numbers, whole_numbers);
    for (const auto [u, v] : Pixels(kWidth, kHeight))
      EXPECT_EQ(depth.values(u, v), static_cast<float>(factor * Value(u, v))) << u << " " << v;
  }

  /// An array's file: the header, a dictionary of Python, then the bytes.
  std::filesystem::path WriteNpy(const std::string& dictionary, const std::string& data) {
    const std::size_t size = dictionary.size() + 1;
    return folder_.Write("a.npy", std::string("\x93NUMPY\x01\x00", 8) +
                                      static_cast<char>(size & 255) + static_cast<char>(size >> 8) +
                                      dictionary + "\n" + data);
  }
  std::filesystem::path WriteNpy(const std::string& type, const std::string& fortran,
                                 const std::string& shape, const std::string& data) {
    return WriteNpy(
        "{'descr': '" + type + "', 'fortran_order': " + fortran + ", 'shape': " + shape + ", }",
        data);
  }

  template <class T>
  static std::string Bytes(T value) {
    return std::string(reinterpret_cast<const char*>(&value), sizeof(T));
  }

  TempFolder folder_;
};

TEST_F(DepthFileTest, PngAndPgm) {
  Image16 image(kWidth, kHeight);
  for (const auto [u, v] : Pixels(kWidth, kHeight))
    image(u, v) = static_cast<std::uint16_t>(Value(u, v));
  WritePng(folder_ / "a.bin", image);  // the content counts, not the name
  ExpectFilled(folder_ / "a.bin", true);
  WritePgm(folder_ / "a.png", image);
  ExpectFilled(folder_ / "a.png", true);
}

TEST_F(DepthFileTest, Tiff) {
  const std::string path = (folder_ / "a.tiff").string();
  ASSERT_TRUE(cv::imwrite(path, Filled(CV_16U)));
  ExpectFilled(path, true);
  ASSERT_TRUE(cv::imwrite(path, Filled(CV_32F, 0.001)));
  ExpectFilled(path, false, 0.001);
  ASSERT_TRUE(cv::imwrite(path, Filled(CV_64F, 0.001)));
  ExpectFilled(path, false, 0.001);
  ASSERT_TRUE(cv::imwrite(path, cv::Mat(kHeight, kWidth, CV_8UC3, cv::Scalar(1, 2, 3))));
  ExpectError<DataError>([&] { ReadStoredDepth(path); }, {"a.tiff", "1 channel", "3"});
}

/// Tiles, packed, in the other byte order.
TEST_F(DepthFileTest, TiledTiff) {
  const std::string path = (folder_ / "tiles.tif").string();
  TIFF* tiff = TIFFOpen(path.c_str(), "wb");
  ASSERT_NE(tiff, nullptr);
  constexpr int kTile = 16, kColumns = 40, kRows = 20;
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kColumns);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kRows);
  TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kTile);
  TIFFSetField(tiff, TIFFTAG_TILELENGTH, kTile);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_LZW);
  for (int y = 0; y < kRows; y += kTile) {
    for (int x = 0; x < kColumns; x += kTile) {
      std::vector<std::uint16_t> tile(std::size_t{kTile} * kTile);
      for (int i = 0; i < kTile * kTile; ++i) {
        tile[static_cast<std::size_t>(i)] =
            static_cast<std::uint16_t>(100 * (y + i / kTile) + x + i % kTile + 1);
      }
      ASSERT_GT(TIFFWriteTile(tiff, tile.data(), static_cast<std::uint32_t>(x),
                              static_cast<std::uint32_t>(y), 0, 0),
                0);
    }
  }
  TIFFClose(tiff);
  const StoredDepth depth = ReadStoredDepth(path);
  ASSERT_EQ(depth.values.width(), kColumns);
  ASSERT_EQ(depth.values.height(), kRows);
  for (const auto [u, v] : Pixels(kColumns, kRows)) ASSERT_EQ(depth.values(u, v), 100 * v + u + 1);
}

int errors_of_others = 0;

// A program that reads TIFFs of its own keeps its handlers, and hears nothing of ours.
TEST_F(DepthFileTest, LeavesLibtiffsHandlersAlone) {
  const std::string path = (folder_ / "a.tiff").string();
  ASSERT_TRUE(cv::imwrite(path, Filled(CV_16U)));
  const std::string whole = ReadFile(path);
  const TIFFErrorHandler own = [](const char*, const char*, va_list) { ++errors_of_others; };
  const TIFFErrorHandler before = TIFFSetErrorHandler(own);
  const TIFFErrorHandler warnings_before = TIFFSetWarningHandler(own);
  ExpectFilled(path, true);
  WriteFileAtomically(path, whole.substr(0, whole.size() / 2));
  ExpectError<DataError>([&] { ReadStoredDepth(path); }, {"a.tiff", "not a readable TIFF: "});
  EXPECT_EQ(TIFFSetErrorHandler(before), own);
  EXPECT_EQ(TIFFSetWarningHandler(warnings_before), own);
  EXPECT_EQ(errors_of_others, 0);
}

TEST_F(DepthFileTest, OpensAFileOnce) {
  Image16 image(kWidth, kHeight, 1000);
  WritePng(folder_ / "a.png", image);
  WritePgm(folder_ / "a.pgm", image);
  for (const char* name : {"a.png", "a.pgm"}) {
    const int watch = inotify_init1(IN_NONBLOCK);
    ASSERT_GE(inotify_add_watch(watch, (folder_ / name).c_str(), IN_OPEN | IN_ACCESS), 0);
    ReadStoredDepth(folder_ / name);
    int opened = 0;
    alignas(inotify_event) char events[4096];
    const ssize_t size = read(watch, events, sizeof(events));
    for (ssize_t at = 0; at < size;) {
      const auto* event = reinterpret_cast<const inotify_event*>(events + at);
      opened += (event->mask & IN_OPEN) != 0 ? 1 : 0;
      at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
    }
    close(watch);
    EXPECT_EQ(opened, 1) << name;
  }
}

/// As Blender names the channels of its layers; the data window does not begin at 0.
TEST_F(DepthFileTest, OpenExrLayers) {
  const Imath::Box2i window(Imath::V2i(3, 2), Imath::V2i(3 + kWidth - 1, 2 + kHeight - 1));
  std::vector<float> depth, colour(std::size_t{kWidth} * kHeight, 0.5f);
  for (const auto [u, v] : Pixels(kWidth, kHeight))
    depth.push_back(static_cast<float>(Value(u, v)));
  for (const char* channel : {"View Layer.Depth.Z", "Depth.Y", "Depth.V"}) {
    Imf::Header header(window, window);
    Imf::FrameBuffer buffer;
    const auto add = [&](const char* name, std::vector<float>* values) {
      header.channels().insert(name, Imf::Channel(Imf::FLOAT));
      buffer.insert(name, Imf::Slice::Make(Imf::FLOAT, values->data(), window));
    };
    for (const char* name : {"View Layer.Combined.R", "View Layer.Combined.G",
                             "View Layer.Combined.B", "View Layer.Combined.A"})
      add(name, &colour);
    add(channel, &depth);
    const std::string path = (folder_ / (std::string(channel) + ".exr")).string();
    {
      Imf::OutputFile file(path.c_str(), header);
      file.setFrameBuffer(buffer);
      file.writePixels(kHeight);
    }
    ExpectFilled(path, false);
  }
}

TEST_F(DepthFileTest, ExrWithManyChannels) {
  const std::string path = (folder_ / "a.exr").string();
  Imf::Header header(kWidth, kHeight);
  for (int i = 0; i < 2000; ++i)
    header.channels().insert(fmt::format("\x1b\n{:0>200}", i), Imf::Channel(Imf::FLOAT));
  { const Imf::OutputFile file(path.c_str(), header); }
  const std::string said = ExpectError<DataError>([&] { ReadStoredDepth(path); });
  EXPECT_LT(said.size(), 600u) << said;
  EXPECT_FALSE(Has(said, "\x1b"));
}

TEST_F(DepthFileTest, OpenExr) {
  ASSERT_EQ(::setenv("OPENCV_IO_ENABLE_OPENEXR", "1", 1), 0);
  const std::string path = (folder_ / "a.exr").string();
  ASSERT_TRUE(cv::imwrite(path, Filled(CV_32F, 0.001)));  // one channel, Y
  ExpectFilled(path, false, 0.001);
  const cv::Mat grey = Filled(CV_32F, 0.001), twice = Filled(CV_32F, 0.002);
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>{grey, grey, grey}, colour);
  ASSERT_TRUE(cv::imwrite(path, colour));
  ExpectFilled(path, false, 0.001);
  cv::merge(std::vector<cv::Mat>{grey, grey, twice}, colour);
  ASSERT_TRUE(cv::imwrite(path, colour));
  ExpectError<DataError>([&] { ReadStoredDepth(path); }, {"a.exr", "differ"});
}

// OpenEXR takes the memory of an attribute before it reads it.
TEST_F(DepthFileTest, ExrWithAnAttributeLargerThanTheFile) {
  using namespace std::string_literals;
  const std::string begin = "\x76\x2f\x31\x01\x02\0\0\0note\0text\0"s;
  for (const std::string& size : {"\x65\x72\x6f\x65"s, "\xff\xff\xff\xff"s}) {
    WriteFileAtomically(folder_ / "a.exr", begin + size + "abcd");
    ExpectError<DataError>([&] { ReadStoredDepth(folder_ / "a.exr"); },
                           {"a.exr", "truncated", "attribute"});
  }
  WriteFileAtomically(folder_ / "a.exr", begin + "\x01"s);
  ExpectError<DataError>([&] { ReadStoredDepth(folder_ / "a.exr"); }, {"a.exr", "truncated"});
}

// A dictionary of Python: each key once, and outside of strings.
TEST_F(DepthFileTest, NpyHeadersThatAreNone) {
  const std::string good = "'descr': '<u2', 'fortran_order': False, 'shape': (5, 7)";
  const auto read = [&](const std::string& dictionary) {
    return ReadStoredDepth(WriteNpy(dictionary, std::string(70, '\1')));
  };
  EXPECT_EQ(read("{" + good + "}").values.width(), 7);
  EXPECT_EQ(read("{ " + good + " , }").values.width(), 7);
  for (const std::string& bad :
       {"{'shape': (5, 6), " + good + "}", "{" + good + ", 'shape': (5, 6)}",
        "{'x': \"'shape': (7, 5)\", " + good + "}", "{" + good + "} {" + good + "}", good,
        std::string("{'descr': '<u2', 'shape': (5, 7)}"), "{" + good})
    ExpectError<DataError>([&] { read(bad); }, {"a.npy", "bad NPY header"});
}

TEST_F(DepthFileTest, Npy) {
  std::string rows, columns, big, halves;
  for (const auto [u, v] : Pixels(kWidth, kHeight)) {
    rows += Bytes(static_cast<float>(0.001 * Value(u, v)));
    const auto whole = static_cast<std::uint16_t>(Value(u, v));
    big += static_cast<char>(whole >> 8);
    big += static_cast<char>(whole & 255);
    // 1024 to 2047 are a half's mantissa steps of 1: exponent 25 of 31, hence 0x6400.
    halves += Bytes(static_cast<std::uint16_t>(0x6400 + whole - 1024 + 100));
  }
  for (int u = 0; u < kWidth; ++u)
    for (int v = 0; v < kHeight; ++v) columns += Bytes(0.001 * Value(u, v));
  const std::string shape = "(5, 7)";
  ExpectFilled(WriteNpy("<f4", "False", shape, rows), false, 0.001);
  ExpectFilled(WriteNpy("<f8", "True", shape, columns), false, 0.001);
  ExpectFilled(WriteNpy(">u2", "False", shape, big), true);
  EXPECT_EQ(ReadStoredDepth(WriteNpy("<f2", "False", shape, halves)).values(3, 1),
            static_cast<float>(Value(3, 1) + 100));

  // A header of blanks, which a backtracking search would go through by recursion.
  const std::string blanks(60000, ' ');
  ExpectFilled(WriteNpy("<f4", blanks + "False", shape, rows), false, 0.001);
  struct Case {
    std::string type, fortran, shape, data, part;
  };
  for (const Case& c : {Case{"<f4", "False", shape, rows.substr(4), "truncated"},
                        Case{"<f4", "False", "(5, 7, 1)", rows, "two dimensions"},
                        Case{"|O", "False", shape, rows, "descr"},
                        Case{"<f4", "Maybe", shape, rows, "fortran_order"},
                        Case{"<f4", "False", blanks, rows, "shape"},
                        Case{"<f4", "False", "(99999999, 99999999)", rows, "no size"}})
    ExpectError<DataError>([&] { ReadStoredDepth(WriteNpy(c.type, c.fortran, c.shape, c.data)); },
                           {"a.npy", c.part});
}

TEST_F(DepthFileTest, WhatIsNoMeasurementIsZero) {
  const std::string data = Bytes(1.5f) + Bytes(std::nanf("")) + Bytes(HUGE_VALF) + Bytes(-1.0f);
  const StoredDepth depth = ReadStoredDepth(WriteNpy("<f4", "False", "(1, 4)", data));
  EXPECT_EQ(depth.values(0, 0), 1.5f);
  for (int u = 1; u < 4; ++u) EXPECT_EQ(depth.values(u, 0), 0) << u;
  ExpectError<DataError>(
      [&] { ReadStoredDepth(WriteNpy("<f4", "False", "(1, 2)", Bytes(-1.5f) + Bytes(0.0f))); },
      {"a.npy", "negative"});
}

TEST_F(DepthFileTest, AnythingElseIsAnError) {
  WriteFileAtomically(folder_ / "a.txt", "GIF89a");
  ExpectError<DataError>([&] { ReadStoredDepth(folder_ / "a.txt"); }, {"a.txt", "NPY"});
  ExpectError<IoError>([&] { ReadStoredDepth(folder_ / "none.npy"); }, {"none.npy"});
}

}  // namespace
}  // namespace volalign::depth_file_test
