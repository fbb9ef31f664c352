#include "infer/formats/kinect_calibration.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::kinect_calibration_test {
namespace {

std::string Camera(const std::string& is, const std::string& rt) {
  return "{" + is + ", \"Rt\": " + rt + "}";
}

std::string Raw(const std::string& cameras) {
  return R"({"CalibrationInformation": {"Cameras": [)" + cameras + "]}}";
}

constexpr char kDepth[] = R"("Purpose": "CALIBRATION_CameraPurposeDepth")";
constexpr char kColour[] = R"("Location": "CALIBRATION_CameraLocationPV0")";
// A quarter turn about z, and about x.
constexpr char kTurnedZ[] =
    R"({"Rotation": [0, -1, 0, 1, 0, 0, 0, 0, 1], "Translation": [0.1, 0.2, 0.3]})";
constexpr char kTurnedX[] =
    R"({"Rotation": [1, 0, 0, 0, 0, -1, 0, 1, 0], "Translation": [0.01, 0.02, 0.03]})";

TEST(ReadKinectColour, GoesThroughTheFrameOfTheDevice) {
  const TempFolder folder;
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
  expect(Raw(Camera(kDepth, kTurnedZ)), "colour camera");
  expect(Raw(Camera(kColour, kTurnedX)), "depth camera");
  expect(Raw(Camera(kColour, "{}") + ", " + Camera(kDepth, kTurnedZ)), "Rt");
  expect(Raw(Camera(kColour, R"({"Rotation": [1, 0], "Translation": [0, 0, 0]})") + ", " +
             Camera(kDepth, kTurnedZ)),
         "2 and 3 numbers");
  EXPECT_THROW(ReadKinectColour(folder / "none.json"), IoError);
}

// Shares of a chip of 4:3 in the raw calibration; a picture of 16:9 is cut out of its middle.
TEST(ParseKinectColour, GivesTheIntrinsicsOfThePictures) {
  const std::string intrinsics =
      R"(, "Intrinsics": {"ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        "ModelParameters": [0.5, 0.52, 0.47, 0.63, 0.1, -2, 1.5, 0.2, -1.9, 1.4, 0, 0, 3e-4, 5e-4]})";
  const std::string raw = Raw("{" + std::string(kColour) + R"(, "Rt": )" + kTurnedX + intrinsics +
                              "}, " + Camera(kDepth, kTurnedZ));
  const Intrinsics k = *ParseKinectColour(raw, "raw", FrameSize{1280, 720}).intrinsics;
  EXPECT_EQ(k.width, 1280);
  EXPECT_EQ(k.height, 720);
  EXPECT_NEAR(k.fx, 0.47 * 1280, 1e-9);
  EXPECT_NEAR(k.fy, 0.63 * 960, 1e-9);
  EXPECT_NEAR(k.cx, 0.5 * 1280 - 0.5, 1e-9);
  EXPECT_NEAR(k.cy, 0.52 * 960 - 120 - 0.5, 1e-9);
  EXPECT_EQ(k.distortion, (std::vector<double>{0.1, -2, 5e-4, 3e-4, 1.5, 0.2, -1.9, 1.4}));
  EXPECT_NEAR(ParseKinectColour(raw, "raw", FrameSize{2048, 1536}).intrinsics->cy,
              0.52 * 1536 - 0.5, 1e-9);
  ExpectError<DataError>(
      [&] {
        ParseKinectColour(raw, "raw", FrameSize{1280, 1000});
      },
      {"raw", "1280x1000"});
}

TEST(FindKinectCamera, GoesByPurposeOrLocation) {
  const YAML::Node root = YAML::Load(Raw(Camera(kColour, "1") + ", " + Camera(kDepth, "2")));
  using formats_internal::FindKinectCamera;
  using formats_internal::KinectCamera;
  EXPECT_EQ(FindKinectCamera(root, KinectCamera::kColour, "file")["Rt"].as<int>(), 1);
  EXPECT_EQ(FindKinectCamera(root, KinectCamera::kDepth, "file")["Rt"].as<int>(), 2);
}

}  // namespace
}  // namespace volalign::kinect_calibration_test
