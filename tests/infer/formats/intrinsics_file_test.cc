#include "infer/formats/intrinsics_file.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <optional>
#include <string>
#include <vector>

#include "infer/formats/kinect_calibration.h"
#include "tests/core/base/comma_locale.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

// The forms in which other programs state intrinsics, written here from their documentation, and
// OpenCV's by OpenCV itself.
namespace volalign::intrinsics_file_test {
namespace {

using namespace formats_internal;

constexpr ImageSize kSize{640, 480};

Intrinsics Parse(const std::string& text, const ImageSize& size = kSize) {
  return ParseIntrinsicsText(text, "file", size);
}

void ExpectBad(const std::string& text, std::initializer_list<std::string> parts) {
  ExpectError<DataError>([&] { Parse(text); }, parts);
}

const Intrinsics kPinhole{640, 480, 525.5, 524.25, 319.5, 239.25, {}};

TEST(IntrinsicsFileTest, OwnKeys) {
  EXPECT_EQ(
      Parse(
          R"({"width": 640, "height": 480, "fx": 525.5, "fy": 524.25, "cx": 319.5, "cy": 239.25})"),
      kPinhole);
  ExpectBad(
      R"({"width": 640, "height": 480, "fx": 525.5, "fy": 524.25, "cx": 319.5, "cy": 239.25, "k1": 0})",
      {"file", "k1"});
}

TEST(IntrinsicsFileTest, Open3d) {
  const std::string matrix = "[525.5, 0, 0, 0, 524.25, 0, 319.5, 239.25, 1]";
  const std::string pinhole =
      "{\"width\": 640, \"height\": 480, \"intrinsic_matrix\": " + matrix + "}";
  EXPECT_EQ(Parse(pinhole), kPinhole);
  EXPECT_EQ(Parse("{\"class_name\": \"PinholeCameraParameters\", \"intrinsic\": " + pinhole + "}"),
            kPinhole);
  // Row by row is another matrix in Open3D.
  ExpectBad(
      R"({"width": 640, "height": 480, "intrinsic_matrix": [525.5, 0, 319.5, 0, 524.25, 239.25, 0, 0, 1]})",
      {"file", "column by column"});
}

TEST(IntrinsicsFileTest, OpencvFileStorage) {
  const TempFolder folder;
  const std::string path = (folder / "camera.yml").string();
  const auto write = [&](const cv::Mat& lens, bool with_size) {
    cv::FileStorage file(path, cv::FileStorage::WRITE);
    if (with_size) file << "image_width" << 640 << "image_height" << 480;
    file << "camera_matrix"
         << (cv::Mat_<double>(3, 3) << 525.5, 0, 319.5, 0, 524.25, 239.25, 0, 0, 1)
         << "distortion_coefficients" << lens;
  };
  Intrinsics expected = kPinhole;
  expected.distortion = {0.1, -0.2, 0.001, 0.002, 0.05};
  write((cv::Mat_<double>(5, 1) << 0.1, -0.2, 0.001, 0.002, 0.05), true);
  EXPECT_EQ(ReadIntrinsicsFile(path, kSize), expected);
  expected.distortion = {1, 2, 3e-4, 4e-4, 5, 6, 7, 8};
  const cv::Mat lens = (cv::Mat_<double>(1, 14) << 1, 2, 3e-4, 4e-4, 5, 6, 7, 8, 0, 0, 0, 0, 0, 0);
  write(lens, true);
  EXPECT_EQ(ReadIntrinsicsFile(path, kSize), expected);
  // For which image size? Not to be guessed.
  write((cv::Mat_<double>(4, 1) << 0, 0, 0, 0), false);
  ExpectError<DataError>([&] { ReadIntrinsicsFile(path, kSize); }, {"camera.yml", "image_width"});
}

TEST(IntrinsicsFileTest, RosCameraInfo) {
  const std::string begin =
      "image_width: 640\nimage_height: 480\ncamera_name: left\n"
      "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [525.5, 0, 319.5, 0, 524.25, 239.25, 0, 0, "
      "1]\n";
  const std::string end =
      "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -0.2, 0.001, 0.002, 0]\n"
      "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n";
  Intrinsics expected = kPinhole;
  expected.distortion = {0.1, -0.2, 0.001, 0.002, 0};
  EXPECT_EQ(Parse(begin + "distortion_model: plumb_bob\n" + end), expected);
  ExpectBad(begin + "distortion_model: equidistant\n" + end, {"file", "equidistant"});
  // As `rostopic echo` and `ros2 topic echo` print the message.
  EXPECT_EQ(
      Parse(
          "height: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: [0.1, -0.2, 0.001, 0.002, "
          "0.0]\n"
          "K: [525.5, 0.0, 319.5, 0.0, 524.25, 239.25, 0.0, 0.0, 1.0]\nbinning_x: 0\nbinning_y: 0\n"
          "roi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: false\n"),
      expected);
  EXPECT_EQ(Parse("height: 480\nwidth: 640\ndistortion_model: plumb_bob\nd:\n- 0.1\n- -0.2\n- "
                  "0.001\n- 0.002\n- 0.0\n"
                  "k:\n- 525.5\n- 0.0\n- 319.5\n- 0.0\n- 524.25\n- 239.25\n- 0.0\n- 0.0\n- 1.0\n"),
            expected);
  ExpectBad(
      "height: 480\nwidth: 640\nK: [525.5, 0, 319.5, 0, 524.25, 239.25, 0, 0, 1]\nbinning_x: 2\n",
      {"file", "binning_x"});
}

/// As `rs-enumerate-devices -c` prints it.
std::string RsEnumerateBlock(const std::string& stream, int width, const std::string& fx,
                             const std::string& lens = "0  \t0  \t0  \t0  \t0") {
  return fmt::format(
      " Intrinsic of \"{}\" / {}x480 / {{Z16}}\n  Width:      \t{}\n  Height:     \t480\n"
      "  PPX:        \t319.5\n  PPY:        \t239.25\n  Fx:         \t{}\n"
      "  Fy:         \t524.25\n  Distortion: \tBrown Conrady\n  Coeffs:     \t{}  \n"
      "  FOV (deg):  \t60 x 50\n\n",
      stream, width, width, fx, lens);
}

TEST(IntrinsicsFileTest, RealSense) {
  Intrinsics rectified = kPinhole;
  rectified.distortion.assign(5, 0.0);
  const std::string begin =
      R"({"width": 640, "height": 480, "fx": 525.5, "fy": 524.25, "ppx": 319.5, "ppy": 239.25, "model": )";
  EXPECT_EQ(Parse(begin + R"("distortion.brown_conrady", "coeffs": [0, 0, 0, 0, 0]})"), rectified);
  EXPECT_EQ(Parse(begin + R"("Inverse Brown Conrady", "coeffs": [0, 0, 0, 0, 0]})"), rectified);
  ExpectBad(begin + R"("distortion.inverse_brown_conrady", "coeffs": [0.1, 0, 0, 0, 0]})",
            {"file", "inverse_brown_conrady"});
  // As print(profile.intrinsics) of pyrealsense2 2.56 has it.
  EXPECT_EQ(Parse("[ 640x480  p[319.5 239.25]  f[525.5 524.25]  Brown Conrady [0 0 0 0 0] ]"),
            rectified);
  EXPECT_EQ(Parse(RsEnumerateBlock("Depth", 848, "600") + RsEnumerateBlock("Depth", 640, "525.5")),
            rectified);
}

std::string Raw(const std::string& cameras) {
  return R"({"CalibrationInformation": {"Cameras": [)" + cameras + "]}}";
}

constexpr char kDepth[] = R"("Purpose": "CALIBRATION_CameraPurposeDepth")";
constexpr char kColour[] = R"("Location": "CALIBRATION_CameraLocationPV0")";

/// A factory calibration on record, at the numbers that the vendor's SDK computes from it.
TEST(IntrinsicsFileTest, AzureKinect) {
  const auto raw = [](const std::string& type, const std::string& numbers) {
    const auto camera = [](const std::string& is, const std::string& lens,
                           const std::string& parameters) {
      return fmt::format(
          R"({{{}, "Intrinsics": {{"ModelType": "CALIBRATION_LensDistortionModel{}", "ModelParameters": [{}]}}}})",
          is, lens, parameters);
    };
    return Raw(camera(kColour, "BrownConrady", "9") + ", " + camera(kDepth, type, numbers));
  };
  const std::string numbers =
      "0.5, 0.51, 0.49, 0.495, 0.92, 0.5, 0.028, 1.25, 0.75, 0.14, 0, 0, -0.0001, 0.0002";
  const std::vector<double> lens = {0.92, 0.5, 0.0002, -0.0001, 0.028, 1.25, 0.75, 0.14};
  const Intrinsics binned = Parse(raw("BrownConrady", numbers), {320, 288});
  EXPECT_NEAR(binned.fx, 250.88, 1e-9);
  EXPECT_NEAR(binned.fy, 253.44, 1e-9);
  EXPECT_NEAR(binned.cx, 159.5, 1e-9);
  EXPECT_NEAR(binned.cy, 170.62, 1e-9);
  EXPECT_EQ(binned.distortion, lens);
  // Twice the size: the same rays, (u + .5) twice as large.
  const Intrinsics whole = Parse(raw("BrownConrady", numbers), {640, 576});
  EXPECT_NEAR(whole.cx, 2 * binned.cx + 0.5, 1e-9);
  EXPECT_NEAR(whole.cy, 2 * binned.cy + 0.5, 1e-9);
  EXPECT_NEAR(whole.fx, 2 * binned.fx, 1e-9);
  const Intrinsics wide = Parse(raw("BrownConrady", numbers), {512, 512});
  EXPECT_NEAR(wide.cx, 255.5, 1e-9);
  EXPECT_EQ(Parse(raw("BrownConrady", numbers), {1024, 1024}).width, 1024);
  ExpectBad(raw("BrownConrady", numbers), {"file", "640x480"});
  ExpectError<DataError>(
      [&] {
        Parse(raw("Rational6KT", numbers), {320, 288});
      },
      {"file", "Rational6KT"});
}

// `init` looks into every text of a folder.
TEST(LooksLikeIntrinsics, KnowsTheKeysAndEndsWithAnyText) {
  for (const char* text : {"fx: 1", "{\"ppx\" : 3}", "K:", "a\n  camera_matrix \t: 1",
                           "x[1 2]  f[3 4]", "Intrinsic of \"Depth\" /"})
    EXPECT_TRUE(LooksLikeIntrinsics(text)) << text;
  for (const char* text : {"", "fx", "pfx: 1", "fx_: 1", "k\"\": 1", "x[1 2]f[3 4]", "ppx 1:"})
    EXPECT_FALSE(LooksLikeIntrinsics(text)) << text;
  constexpr std::size_t kLong = 400000;
  for (const std::string& text : {"fx" + std::string(kLong, ' '), "]" + std::string(kLong, ' '),
                                  std::string(kLong, ':'), std::string(kLong, '\n') + ":"})
    EXPECT_FALSE(LooksLikeIntrinsics(text));
}

TEST(IntrinsicsFileTest, EndsWithAliasesOfAliases) {
  std::string text = "width: 1\nheight: 1\na0: &a0 [1]\n";
  for (int level = 1; level <= 10; ++level) {
    const std::string alias = "*a" + std::to_string(level - 1);
    text += "a" + std::to_string(level) + ": &a" + std::to_string(level) + " [" + alias;
    for (int i = 0; i < 9; ++i) text += ", " + alias;
    text += "]\n";
  }
  ExpectBad(text + "K: *a10\n", {"file", "alias", "1000000"});
}

TEST(IntrinsicsFileTest, SaysWhatItExpected) {
  ExpectBad("hello: world\n", {"file", "camera_matrix", "ppx"});
  ExpectBad("K: [1, 2\n", {"file", "line"});
  for (const char* text : {"just text", "", "K: {a: b}\nwidth: 1\n"}) ExpectBad(text, {"file"});
}

// DepthAI's calibration has every camera by its socket; depth is the rectified right one's.
TEST(ParseIntrinsicsText, DepthAi) {
  const std::string json = R"({"boardName": "OAK-D", "cameraData": [
      [0, {"width": 1920, "height": 1080, "intrinsicMatrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}],
      [2, {"width": 1280, "height": 800, "distortionCoeff": [1, 2, 3],
           "intrinsicMatrix": [[800, 0, 640], [0, 801, 400], [0, 0, 1]]}]]})";
  EXPECT_TRUE(LooksLikeIntrinsics(json));
  const Intrinsics k = ParseIntrinsicsText(json, "a.json", {640, 400});
  EXPECT_EQ(k.fx, 400);
  EXPECT_EQ(k.fy, 400.5);
  EXPECT_EQ(k.cx, 640.5 / 2 - 0.5);
  EXPECT_EQ(k.distortion, std::vector<double>(5, 0.0));
  EXPECT_THROW(ParseIntrinsicsText(json, "a.json", {640, 480}), DataError);
  EXPECT_THROW(ParseIntrinsicsText(R"({"cameraData": [[1, {}]]})", "a.json", {640, 400}),
               DataError);
}

TEST(WhyNoText, NamesWhatNoReaderTakes) {
  const std::string utf16("\xff\xfew\0i\0", 6);
  EXPECT_TRUE(Has(WhyNoText(utf16), "UTF-8"));
  EXPECT_TRUE(Has(WhyNoText(std::string("w\0i\0", 4)), "UTF-8"));
  EXPECT_TRUE(Has(WhyNoText("\xef\xbb\xbf <?xml version=\"1.0\"?>"), "XML"));
  for (const char* text : {"", "<OBCameraParam depth", "\xef\xbb\xbf{\"fx\": 1}", "K: [1]"})
    EXPECT_EQ(WhyNoText(text), "") << text;
  ExpectError<DataError>([&] { ParseIntrinsicsText(utf16, "k.txt", {4, 3}); }, {"k.txt", "UTF-16"});
}

TEST(PrintOfPyrealsense, TellsFocalLengthsFromThePrincipalPointWhateverTheLocale) {
  for (const bool comma : {false, true}) {
    std::optional<CommaLocale> locale;
    if (comma) locale.emplace();
    const Intrinsics found = Parse(
        "depth: [ 640x480  p[318.500 240.9]  f[383.300 384.4]  Brown Conrady [0.1 0 0 0.2 0] ]");
    const Intrinsics own = Parse("fx: 525.5\nfy: 1\nppx: 1\nppy: 1\nwidth: 640\nheight: 480\n");
    EXPECT_EQ(own.fx, 525.5);
    EXPECT_EQ(found, (Intrinsics{640, 480, 383.3, 384.4, 318.5, 240.9, {0.1, 0, 0, 0.2, 0}}));
  }
  ExpectBad("[ 640x480  p[x 240.9]  f[1 2]  Brown Conrady [0 0 0 0 0] ]", {"file", "p[...]"});
  ExpectBad("[ 640x480  p[1 2]  f[1 2]  Ftheta [1 0 0 0 0] ]", {"file", "Ftheta"});
}

// Blanks and brackets without end, which a backtracking search would go through by recursion, or
// from each bracket anew.
TEST(PrintOfPyrealsense, EndsWithAnyText) {
  constexpr std::size_t kLong = 400000;
  std::string brackets;
  for (std::size_t i = 0; i < kLong / 10; ++i) brackets += "[1x1 p[1 1";
  for (const std::string& text : {"[" + std::string(kLong, ' '), std::string(kLong, '['), brackets,
                                  "[1x1  p[1 1] f[1 1] " + std::string(kLong, 'a') + "[0] ]"})
    ExpectBad(text, {"file"});
  ExpectBad("[ 9x9  p[1 2 3]  f[4]  None [0] ]", {"two numbers each"});
}

TEST(PrintOfRsEnumerate, EndsWithAnyText) {
  constexpr std::size_t kLong = 400000;
  ExpectBad("Intrinsic of \"Depth\"\n" + std::string(kLong, ' '), {"file", "Width is missing"});
}

TEST(PrintOfRsEnumerate, TakesTheDepthStreamOfTheFramesSize) {
  const auto block = [](const std::string& stream, int width, const std::string& fx) {
    return RsEnumerateBlock(stream, width, fx, "0.1 0 0 0 0");
  };
  const std::string text = block("Color", 640, "700") + block("Depth", 848, "600") +
                           block("Depth", 640, "525.5") + block("Infrared", 640, "800");
  EXPECT_EQ(Parse(text), (Intrinsics{640, 480, 525.5, 524.25, 319.5, 239.25, {0.1, 0, 0, 0, 0}}));
  EXPECT_EQ(Parse(text, {848, 480}).fx, 600);
  ExpectError<DataError>([&] { Parse(text, {1280, 480}); }, {"file", "1280x480"});
  ExpectBad(block("Color", 640, "700"), {"file"});
  std::string broken = block("Depth", 640, "525.5");
  broken.replace(broken.find("\t640"), 4, "\t640.9");
  ExpectBad(broken, {"640x480"});
  // A number of a block that has none is not taken from the next one.
  ExpectBad(block("Depth", 640, "none") + text, {"file", "fx", "none"});
}

TEST(PrintOfPyorbbec, ReordersTheLens) {
  const std::string print =
      "<OBCameraParam depth_intrinsic < fx=504.507 fy=504.528 cx=326.349 cy=343.595 width=640 "
      "height=576 > \n depth_distortion < k1=16.1704 k2=8.44953 k3=0.324469 k4=16.4805 k5=13.9441 "
      "k6=1.99604 p1=5.93e-05 p2=-1.47e-05 > \n rgb_intrinsic < fx=1 fy=1 cx=1 cy=1 width=2 "
      "height=2 > >";
  const Intrinsics k = Parse(print);
  EXPECT_EQ(k.width, 640);
  EXPECT_EQ(k.cy, 343.595);
  EXPECT_EQ(k.distortion, (std::vector<double>{16.1704, 8.44953, 5.93e-05, -1.47e-05, 0.324469,
                                               16.4805, 13.9441, 1.99604}));
  ExpectBad("<OBCameraParam depth_intrinsic < fx=1 >", {"file", "depth_distortion"});
  ExpectBad("<OBCameraParam depth_intrinsic < fx=1 > depth_distortion < k1=x >", {"file", "k1"});
}

std::string Camera(const std::string& is, const std::string& rt) {
  return "{" + is + ", \"Rt\": " + rt + "}";
}

// A quarter turn about z, and about x.
constexpr char kTurnedZ[] =
    R"({"Rotation": [0, -1, 0, 1, 0, 0, 0, 0, 1], "Translation": [0.1, 0.2, 0.3]})";
constexpr char kTurnedX[] =
    R"({"Rotation": [1, 0, 0, 0, 0, -1, 0, 1, 0], "Translation": [0.01, 0.02, 0.03]})";

TEST(ReadKinectColour, GoesThroughTheFrameOfTheDevice) {
  const TempFolder folder;
  const CommaLocale locale;
  const ColourCamera camera = ReadKinectColour(
      folder.Write("raw.json", Raw(Camera(kColour, kTurnedX) + ", " + Camera(kDepth, kTurnedZ))));
  EXPECT_FALSE(camera.intrinsics);
  const Pose& colour_from_depth = camera.colour_from_depth;
  // A point of the device's frame, as each camera has it.
  const Eigen::Vector3d depth(-2 + 0.1, 1 + 0.2, 3 + 0.3), colour(1 + 0.01, -3 + 0.02, 2 + 0.03);
  EXPECT_LT((colour_from_depth * depth - colour).norm(), 1e-12);
}

TEST(ReadKinectColour, SaysWhatIsMissing) {
  const TempFolder folder;
  const auto expect = [&](const std::string& text, const std::string& part) {
    const std::filesystem::path path = folder.Write("raw.json", text);
    ExpectError<DataError>([&] { ReadKinectColour(path); }, {"raw.json", part});
  };
  expect("{}", "CalibrationInformation");
  expect("{\"CalibrationInformation\": [", "line 1");
  expect(Raw(Camera(kDepth, kTurnedZ)), "colour camera");
  expect(Raw(Camera(kColour, kTurnedX)), "depth camera");
  expect(Raw(Camera(kColour, "{}") + ", " + Camera(kDepth, kTurnedZ)), "Rt");
  expect(Raw(Camera(kColour, R"({"Rotation": [1, 0], "Translation": [0, 0, 0]})") + ", " +
             Camera(kDepth, kTurnedZ)),
         "Rotation has 2 values, not 9");
  EXPECT_THROW(ReadKinectColour(folder / "none.json"), IoError);
}

// Shares of a chip of 4:3 in the raw calibration; a picture of 16:9 is cut out of its middle.
TEST(ParseKinectColour, GivesTheIntrinsicsOfThePictures) {
  const std::string intrinsics =
      R"(, "Intrinsics": {"ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        "ModelParameters": [0.5, 0.52, 0.47, 0.63, 0.1, -2, 1.5, 0.2, -1.9, 1.4, 0, 0, 3e-4, 5e-4]})";
  const std::string raw = Raw("{" + std::string(kColour) + R"(, "Rt": )" + kTurnedX + intrinsics +
                              "}, " + Camera(kDepth, kTurnedZ));
  const Intrinsics k = *ParseKinectColour(raw, "raw", ImageSize{1280, 720}).intrinsics;
  EXPECT_EQ(k.width, 1280);
  EXPECT_EQ(k.height, 720);
  EXPECT_NEAR(k.fx, 0.47 * 1280, 1e-9);
  EXPECT_NEAR(k.fy, 0.63 * 960, 1e-9);
  EXPECT_NEAR(k.cx, 0.5 * 1280 - 0.5, 1e-9);
  EXPECT_NEAR(k.cy, 0.52 * 960 - 120 - 0.5, 1e-9);
  EXPECT_EQ(k.distortion, (std::vector<double>{0.1, -2, 5e-4, 3e-4, 1.5, 0.2, -1.9, 1.4}));
  EXPECT_NEAR(ParseKinectColour(raw, "raw", ImageSize{2048, 1536}).intrinsics->cy,
              0.52 * 1536 - 0.5, 1e-9);
  ExpectError<DataError>(
      [&] {
        ParseKinectColour(raw, "raw", ImageSize{1280, 1000});
      },
      {"raw", "1280x1000"});
}

using Numbers = std::vector<double>;

TEST(NamedLens, TakesOpencvsModelsUnderTheirNames) {
  const Numbers lens = {0.1, -0.2, 0.001, 0.002, 0.05};
  for (const char* model :
       {"plumb_bob", "rational_polynomial", "Brown Conrady", "", "brown-conrady",
        "RS2_DISTORTION_BROWN_CONRADY", "distortion.brown_conrady"})
    EXPECT_EQ(NamedLens(model, lens, "file"), lens) << model;
  for (const char* model : {"equidistant", "Inverse Brown Conrady", "Kannala Brandt4"})
    ExpectError<DataError>([&] { NamedLens(model, lens, "file"); }, {"file", model});
}

TEST(NamedLens, ALensWithoutEffectHasAnyName) {
  EXPECT_EQ(NamedLens("equidistant", {0, 0, 0, 0}, "file"), Numbers(5));
  EXPECT_EQ(NamedLens("equidistant", {}, "file"), Numbers());
}

TEST(NamedLens, HasAtMostEightCoefficients) {
  Numbers lens = {1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 0};
  EXPECT_EQ(NamedLens("rational_polynomial", lens, "file"), (Numbers{1, 2, 3, 4, 5, 6, 7, 8}));
  lens[11] = 0.1;
  ExpectError<DataError>([&] { NamedLens("rational_polynomial", lens, "file"); },
                         {"file", "12 distortion coefficients", "thin prism"});
}

}  // namespace
}  // namespace volalign::intrinsics_file_test
