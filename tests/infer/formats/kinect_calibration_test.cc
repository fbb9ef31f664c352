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

TEST(ReadColourFromDepth, GoesThroughTheFrameOfTheDevice) {
  const TempFolder folder;
  const Pose colour_from_depth = ReadColourFromDepth(
      folder.Write("raw.json", Raw(Camera(kColour, kTurnedX) + ", " + Camera(kDepth, kTurnedZ))));
  // A point of the device's frame, as each camera has it.
  const Eigen::Vector3d depth(-2 + 0.1, 1 + 0.2, 3 + 0.3), colour(1 + 0.01, -3 + 0.02, 2 + 0.03);
  EXPECT_LT((colour_from_depth * depth - colour).norm(), 1e-12);
}

TEST(ReadColourFromDepth, SaysWhatIsMissing) {
  const TempFolder folder;
  const auto expect = [&](const std::string& text, const std::string& part) {
    const std::filesystem::path path = folder.Write("raw.json", text);
    ExpectError<DataError>([&] { ReadColourFromDepth(path); }, {"raw.json", part});
  };
  expect("{}", "CalibrationInformation");
  expect(Raw(Camera(kDepth, kTurnedZ)), "colour camera");
  expect(Raw(Camera(kColour, kTurnedX)), "depth camera");
  expect(Raw(Camera(kColour, "{}") + ", " + Camera(kDepth, kTurnedZ)), "Rt");
  expect(Raw(Camera(kColour, R"({"Rotation": [1, 0], "Translation": [0, 0, 0]})") + ", " +
             Camera(kDepth, kTurnedZ)),
         "2 and 3 numbers");
  EXPECT_THROW(ReadColourFromDepth(folder / "none.json"), IoError);
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
