#include "infer/formats/kinect_calibration.h"

#include <fmt/format.h>

#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"
#include "infer/formats/poses/sensor_pose.h"

namespace volalign {

namespace {

enum class KinectCamera { kDepth, kColour };

/// A frame that is cut out of a chip, whole or binned, at (left, top), pixels.
struct KinectMode {
  int width, height, chip_width, chip_height, left, top;
  const char* kind = "";  ///< name in configs/intrinsics.yaml
};

/// "Rt" of a camera: the rotation row by row, and metres. Rt of every camera maps points of one
/// frame, which the cameras of a device share, into its own (extrinsic_transformation.c of the
/// Azure Kinect Sensor SDK).
Pose CameraFromDevice(const YAML::Node& camera, const std::string& name) {
  const YAML::Node rt = camera["Rt"];
  if (!rt || !rt["Rotation"] || !rt["Translation"]) {
    throw DataError(name +
                    ": a camera has no Rt, its place in the device; give the whole raw "
                    "calibration, as the device or a recording's calibration.json has it");
  }
  const std::vector<double> r = YamlNumbers(rt["Rotation"]);
  const std::vector<double> t = YamlNumbers(rt["Translation"]);
  if (r.size() != 9 || t.size() != 3)
    throw DataError(
        fmt::format("{}: Rt has {} and {} numbers, not 9 and 3", name, r.size(), t.size()));
  return PoseFromRotation(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()),
                          Eigen::Map<const Eigen::Vector3d>(t.data()), name + ": Rt");
}

/// The camera in a raw calibration. Throws DataError if it has none.
YAML::Node FindKinectCamera(const YAML::Node& root, KinectCamera camera, const std::string& name) {
  const bool depth = camera == KinectCamera::kDepth;
  for (const YAML::Node& node : root["CalibrationInformation"]["Cameras"]) {
    const std::string purpose = node["Purpose"] ? node["Purpose"].as<std::string>() : "";
    const std::string location = node["Location"] ? node["Location"].as<std::string>() : "";
    if (purpose ==
            (depth ? "CALIBRATION_CameraPurposeDepth" : "CALIBRATION_CameraPurposePhotoVideo") ||
        location == (depth ? "CALIBRATION_CameraLocationD0" : "CALIBRATION_CameraLocationPV0"))
      return node;
  }
  throw DataError(fmt::format("{}: no camera of CalibrationInformation is the {} camera", name,
                              depth ? "depth" : "colour"));
}

/// The intrinsics of such frames.
Intrinsics KinectIntrinsics(const YAML::Node& camera, const KinectMode& mode,
                            const std::string& name) {
  const YAML::Node given = camera["Intrinsics"];
  const auto type = given["ModelType"].as<std::string>();
  const std::vector<double> p = YamlNumbers(given["ModelParameters"]);
  if (type != "CALIBRATION_LensDistortionModelBrownConrady" || p.size() < 14)
    throw DataError(fmt::format("{}: ModelType {} with {} parameters is unknown", name,
                                Shortened(type), p.size()));
  // cx cy fx fy k1 k2 k3 k4 k5 k6 codx cody p2 p1, the first four as shares of the chip's sides.
  if (p[10] != 0 || p[11] != 0)
    throw DataError(name + ": codx and cody, the centre of distortion, are not 0");
  return {mode.width,
          mode.height,
          p[2] * mode.chip_width,
          p[3] * mode.chip_height,
          p[0] * mode.chip_width - mode.left - 0.5,
          p[1] * mode.chip_height - mode.top - 0.5,
          {p[4], p[5], p[13], p[12], p[6], p[7], p[8], p[9]}};
}

/// The colour camera's chip is of 4:3; pictures of 16:9 are cut out of its middle, binned or not
/// (Azure Kinect Sensor SDK, src/transformation/mode_specific_calibration.c).
KinectMode ColourMode(const ImageSize& picture, const std::string& name) {
  const int height = picture.width * 3 / 4;
  if (4 * height != 3 * picture.width || picture.height > height ||
      (height - picture.height) % 2 != 0) {
    throw DataError(fmt::format("{}: an Azure Kinect has no colour pictures of {}x{}", name,
                                picture.width, picture.height));
  }
  return {picture.width, picture.height, picture.width, height, 0, (height - picture.height) / 2};
}

constexpr KinectMode kDepthModes[] = {
    {320, 288, 512, 512, 96, 90, "azure_kinect_nfov_binned"},
    {640, 576, 1024, 1024, 192, 180, "azure_kinect_nfov_unbinned"},
    {512, 512, 512, 512, 0, 0, "azure_kinect_wfov_binned"},
    {1024, 1024, 1024, 1024, 0, 0, "azure_kinect_wfov_unbinned"}};

/// Null for frames of another size.
const KinectMode* ModeOf(const ImageSize& frame) {
  for (const KinectMode& mode : kDepthModes) {
    if (mode.width == frame.width && mode.height == frame.height) return &mode;
  }
  return nullptr;
}

}  // namespace

namespace formats_internal {

std::string KinectKind(const ImageSize& frame) {
  const KinectMode* const mode = ModeOf(frame);
  return mode ? mode->kind : "";
}

Intrinsics KinectDepthIntrinsics(const YAML::Node& root, const std::string& name,
                                 const ImageSize& frame) {
  const KinectMode* const mode = ModeOf(frame);
  if (!mode) {
    throw DataError(fmt::format(
        "{}: an Azure Kinect has no depth frames of {}x{} (but 320x288, 640x576, 512x512 and "
        "1024x1024), so that its raw calibration does not hold for this one",
        name, frame.width, frame.height));
  }
  return KinectIntrinsics(FindKinectCamera(root, KinectCamera::kDepth, name), *mode, name);
}

}  // namespace formats_internal

ColourCamera ParseKinectColour(const std::string& text, const std::string& name,
                               const std::optional<ImageSize>& picture) {
  try {
    const YAML::Node root = LoadYaml(text, YamlDocuments::kFirst);
    if (!root.IsMap() || !root["CalibrationInformation"]) {
      throw DataError(name +
                      ": no raw calibration of an Azure Kinect (a JSON file that begins with "
                      "CalibrationInformation)");
    }
    const YAML::Node colour = FindKinectCamera(root, KinectCamera::kColour, name);
    ColourCamera camera;
    camera.colour_from_depth =
        CameraFromDevice(colour, name) *
        CameraFromDevice(FindKinectCamera(root, KinectCamera::kDepth, name), name).inverse();
    if (picture) {
      camera.intrinsics = KinectIntrinsics(colour, ColourMode(*picture, name), name);
      camera.intrinsics->Validate(name);
    }
    return camera;
  } catch (const YAML::Exception& error) {
    throw DataError(YamlProblemIn(name, error));
  }
}

ColourCamera ReadKinectColour(const std::filesystem::path& path) {
  return ParseKinectColour(ReadFile(path, kMaxTextBytes), path.string(), std::nullopt);
}

}  // namespace volalign
