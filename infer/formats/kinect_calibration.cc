#include "infer/formats/kinect_calibration.h"

#include <fmt/format.h>

#include <array>
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
Pose CameraFromDevice(const ObjectReader& camera) {
  if (!camera.Has("Rt")) {
    throw DataError(camera.where() +
                    " has no Rt, its place in the device; give the whole raw calibration, as the "
                    "device or a recording's calibration.json has it");
  }
  const ObjectReader rt = camera.Child("Rt");
  const auto r = rt.Read<std::array<double, 9>>("Rotation");
  return PoseFromRotation(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()),
                          rt.Read<Eigen::Vector3d>("Translation"), rt.where());
}

/// The camera in a raw calibration. Throws DataError if it has none.
ObjectReader FindKinectCamera(const ObjectReader& calibration, KinectCamera camera) {
  const bool depth = camera == KinectCamera::kDepth;
  const auto is = [](const ObjectReader& of, const char* key, const char* word) {
    return of.Has(key) && of.Text(key) == word;
  };
  for (const ObjectReader& of : calibration.Child("CalibrationInformation").Children("Cameras")) {
    if (is(of, "Purpose",
           depth ? "CALIBRATION_CameraPurposeDepth" : "CALIBRATION_CameraPurposePhotoVideo") ||
        is(of, "Location",
           depth ? "CALIBRATION_CameraLocationD0" : "CALIBRATION_CameraLocationPV0"))
      return of;
  }
  throw DataError(fmt::format("{}: no camera of CalibrationInformation is the {} camera",
                              calibration.where(), depth ? "depth" : "colour"));
}

/// The intrinsics of such frames.
Intrinsics KinectIntrinsics(const ObjectReader& camera, const KinectMode& mode) {
  const ObjectReader given = camera.Child("Intrinsics");
  const std::string type = given.Text("ModelType");
  const auto p = given.Read<std::vector<double>>("ModelParameters");
  if (type != "CALIBRATION_LensDistortionModelBrownConrady" || p.size() < 14)
    throw DataError(fmt::format("{}: ModelType {} with {} parameters is unknown", given.where(),
                                Shortened(type), p.size()));
  // cx cy fx fy k1 k2 k3 k4 k5 k6 codx cody p2 p1, the first four as shares of the chip's sides.
  if (p[10] != 0 || p[11] != 0)
    throw DataError(given.where() + ": codx and cody, the centre of distortion, are not 0");
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

Intrinsics KinectDepthIntrinsics(const ObjectReader& calibration, const ImageSize& frame) {
  const KinectMode* const mode = ModeOf(frame);
  if (!mode) {
    throw DataError(fmt::format(
        "{}: an Azure Kinect has no depth frames of {}x{} (but 320x288, 640x576, 512x512 and "
        "1024x1024), so that its raw calibration does not hold for this one",
        calibration.where(), frame.width, frame.height));
  }
  return KinectIntrinsics(FindKinectCamera(calibration, KinectCamera::kDepth), *mode);
}

}  // namespace formats_internal

ColourCamera ParseKinectColour(const std::string& text, const std::string& name,
                               const std::optional<ImageSize>& picture) {
  const nlohmann::json tree = YamlTree(text, name);
  if (!tree.is_object() || !tree.contains("CalibrationInformation")) {
    throw DataError(name +
                    ": no raw calibration of an Azure Kinect (a JSON file that begins with "
                    "CalibrationInformation)");
  }
  const ObjectReader calibration(tree, name);
  const ObjectReader colour = FindKinectCamera(calibration, KinectCamera::kColour);
  ColourCamera camera;
  camera.colour_from_depth =
      CameraFromDevice(colour) *
      CameraFromDevice(FindKinectCamera(calibration, KinectCamera::kDepth)).inverse();
  if (picture) {
    camera.intrinsics = KinectIntrinsics(colour, ColourMode(*picture, name));
    camera.intrinsics->Validate(name);
  }
  return camera;
}

ColourCamera ReadKinectColour(const std::filesystem::path& path) {
  return ParseKinectColour(ReadFile(path, kMaxTextBytes), path.string(), std::nullopt);
}

}  // namespace volalign
