#include "infer/formats/intrinsics_file.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <optional>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"
#include "core/geometry/lens.h"
#include "infer/formats/kinect_calibration.h"
#include "infer/formats/lens_names.h"
#include "infer/formats/printed_intrinsics.h"

namespace volalign {

using formats_internal::NamedLens;

namespace {

constexpr char kForms[] =
    "expected volalign's keys (width, height, fx, fy, cx, cy), Open3D's intrinsic_matrix, OpenCV's "
    "or ROS's camera_matrix, RealSense's ppx and coeffs, the Azure Kinect's "
    "CalibrationInformation, "
    "pyorbbecsdk's OBCameraParam, or DepthAI's cameraData";

/// Each alone shows that a text is one of intrinsics.
constexpr std::string_view kTellingKeys[] = {"CalibrationInformation",
                                             "cameraData",
                                             "intrinsic_matrix",
                                             "ppx",
                                             "camera_matrix",
                                             "cameraMatrix",
                                             "K",
                                             "k",
                                             "fx"};

constexpr char kBlanks[] = " \t\r\n\v\f";

std::string_view WithoutBlanksBehind(std::string_view text) {
  return text.substr(0, text.find_last_not_of(kBlanks) + 1);
}

bool EndsWith(std::string_view text, std::string_view end) {
  return text.size() >= end.size() && text.substr(text.size() - end.size()) == end;
}

bool IsOfWord(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

/// The first of `keys` that the map has.
YAML::Node FirstOf(const YAML::Node& map, std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    if (map[key]) return map[key];
  }
  return YAML::Node(YAML::NodeType::Undefined);
}

YAML::Node Required(const YAML::Node& map, std::initializer_list<const char*> keys,
                    const std::string& name) {
  YAML::Node node = FirstOf(map, keys);
  if (!node) {
    throw DataError(fmt::format(
        "{}: {} is missing; state the image size and the lens for which the intrinsics hold", name,
        *keys.begin()));
  }
  return node;
}

void AppendNumbers(const YAML::Node& node, std::vector<double>* numbers) {
  if (node.IsSequence()) {
    for (const YAML::Node& item : node) AppendNumbers(item, numbers);
  } else {
    numbers->push_back(node.as<double>());
  }
}

/// The numbers of [1, 2], [[1], [2]] or {rows, cols, data: [1, 2]}.
std::vector<double> Numbers(const YAML::Node& node) {
  std::vector<double> numbers;
  AppendNumbers(node.IsMap() && node["data"] ? node["data"] : node, &numbers);
  return numbers;
}

Intrinsics FromMatrix(const YAML::Node& map, const YAML::Node& matrix, const std::string& name) {
  const std::vector<double> k = Numbers(matrix);
  if (k.size() != 9)
    throw DataError(fmt::format("{}: a camera matrix of {} numbers, not 9", name, k.size()));
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    throw DataError(name +
                    ": the camera matrix is not [fx, 0, cx, 0, fy, cy, 0, 0, 1], row by row");
  }
  for (const char* key : {"binning_x", "binning_y"}) {
    if (map[key] && map[key].as<int>() > 1)
      throw DataError(fmt::format("{}: {} = {}: give the intrinsics of the image as it is stored",
                                  name, key, map[key].as<int>()));
  }
  if (const YAML::Node roi = map["roi"];
      roi && roi.IsMap() && roi["x_offset"] &&
      (roi["x_offset"].as<int>() != 0 || roi["y_offset"].as<int>() != 0)) {
    throw DataError(name + ": roi: give the intrinsics of the image as it is stored, cut out");
  }
  Intrinsics intrinsics{Required(map, {"image_width", "width"}, name).as<int>(),
                        Required(map, {"image_height", "height"}, name).as<int>(),
                        k[0],
                        k[4],
                        k[2],
                        k[5],
                        {}};
  const YAML::Node lens = FirstOf(
      map, {"distortion_coefficients", "D", "d", "dist_coeffs", "distCoeffs", "distortion"});
  const YAML::Node model = map["distortion_model"];
  if (lens) {
    intrinsics.distortion = NamedLens(model ? model.as<std::string>() : "", Numbers(lens), name);
  }
  return intrinsics;
}

Intrinsics FromOpen3d(const YAML::Node& map, const std::string& name) {
  const std::vector<double> k = Numbers(map["intrinsic_matrix"]);
  if (k.size() != 9 || k[1] != 0 || k[2] != 0 || k[3] != 0 || k[5] != 0 || k[8] != 1) {
    throw DataError(name +
                    ": intrinsic_matrix is not [fx, 0, 0, 0, fy, 0, cx, cy, 1], column by column "
                    "as Open3D has it");
  }
  return {Required(map, {"width"}, name).as<int>(),
          Required(map, {"height"}, name).as<int>(),
          k[0],
          k[4],
          k[6],
          k[7],
          {}};
}

Intrinsics FromRealSense(const YAML::Node& map, const std::string& name) {
  Intrinsics intrinsics;
  intrinsics.width = Required(map, {"width"}, name).as<int>();
  intrinsics.height = Required(map, {"height"}, name).as<int>();
  intrinsics.fx = Required(map, {"fx"}, name).as<double>();
  intrinsics.fy = Required(map, {"fy"}, name).as<double>();
  intrinsics.cx = Required(map, {"ppx"}, name).as<double>();
  intrinsics.cy = Required(map, {"ppy"}, name).as<double>();
  const YAML::Node model = FirstOf(map, {"model", "distortion_model", "distortion"});
  if (const YAML::Node coefficients = FirstOf(map, {"coeffs", "coefficients"})) {
    intrinsics.distortion = NamedLens(model && model.IsScalar() ? model.as<std::string>() : "",
                                      Numbers(coefficients), name);
  }
  return intrinsics;
}

constexpr formats_internal::KinectMode kKinectModes[] = {{320, 288, 512, 512, 96, 90},
                                                         {640, 576, 1024, 1024, 192, 180},
                                                         {512, 512, 512, 512, 0, 0},
                                                         {1024, 1024, 1024, 1024, 0, 0}};

Intrinsics FromKinect(const YAML::Node& root, const std::string& name, const FrameSize& frame) {
  const auto* mode = std::find_if(std::begin(kKinectModes), std::end(kKinectModes),
                                  [&](const formats_internal::KinectMode& m) {
                                    return m.width == frame.width && m.height == frame.height;
                                  });
  if (mode == std::end(kKinectModes)) {
    throw DataError(fmt::format(
        "{}: an Azure Kinect has no depth frames of {}x{} (but 320x288, 640x576, 512x512 and "
        "1024x1024), so that its raw calibration does not hold for this one",
        name, frame.width, frame.height));
  }
  return formats_internal::KinectIntrinsics(
      formats_internal::FindKinectCamera(root, formats_internal::KinectCamera::kDepth, name), *mode,
      name);
}

/// A calibration of DepthAI: `cameraData` is a list of [socket, camera]. Depth is computed from
/// rectified pictures, with the right camera's matrix (H1 = M2 R1 M1^-1, H2 = M2 R2 M2^-1 in
/// Luxonis' calibration_utils.py), and aligned to that camera unless the pipeline says otherwise.
Intrinsics FromDepthAi(const YAML::Node& root, const std::string& name, const FrameSize& frame) {
  constexpr int kRight = 2;  // CameraBoardSocket::CAM_C
  for (const YAML::Node& pair : root["cameraData"]) {
    if (!pair.IsSequence() || pair.size() != 2 || pair[0].as<int>() != kRight) continue;
    const YAML::Node camera = pair[1];
    const std::vector<double> k = Numbers(Required(camera, {"intrinsicMatrix"}, name));
    if (k.size() != 9)
      throw DataError(fmt::format("{}: a camera matrix of {} numbers, not 9", name, k.size()));
    const Intrinsics given{Required(camera, {"width"}, name).as<int>(),
                           Required(camera, {"height"}, name).as<int>(),
                           k[0],
                           k[4],
                           k[2],
                           k[5],
                           std::vector<double>(5, 0.0)};
    given.Validate(name);
    if (std::int64_t{given.width} * frame.height != std::int64_t{given.height} * frame.width) {
      throw DataError(fmt::format(
          "{}: the right camera was calibrated at {}x{}, the frames are {}x{}: they are "
          "cut out or aligned to another camera; give their intrinsics",
          name, given.width, given.height, frame.width, frame.height));
    }
    return given.Resized(frame.width, frame.height);
  }
  throw DataError(name + ": cameraData has no right camera (socket 2)");
}

/// A document without the directive of OpenCV's FileStorage, which yaml-cpp does not know.
YAML::Node Load(const std::string& text) {
  std::size_t begin = 0;
  if (text.compare(0, 5, "%YAML") == 0) begin = std::min(text.find('\n'), text.size());
  return LoadYaml(text.substr(begin), YamlDocuments::kFirst);
}

Intrinsics FromDocument(const std::string& text, const std::string& name, const FrameSize& frame) {
  const YAML::Node root = Load(text);
  if (!root.IsMap()) throw DataError(fmt::format("{}: no intrinsics; {}", name, kForms));
  if (root["CalibrationInformation"]) return FromKinect(root, name, frame);
  if (root["cameraData"]) return FromDepthAi(root, name, frame);
  if (root["intrinsic_matrix"]) return FromOpen3d(root, name);
  if (root["intrinsic"] && root["intrinsic"].IsMap()) return FromOpen3d(root["intrinsic"], name);
  if (root["ppx"]) return FromRealSense(root, name);
  if (const YAML::Node matrix = FirstOf(root, {"camera_matrix", "cameraMatrix", "K", "k"}))
    return FromMatrix(root, matrix, name);
  if (root["fx"]) {
    const nlohmann::json json = ParseStrictJson(text, name);
    const JsonObject object(json, name);
    Intrinsics intrinsics = ParseIntrinsics(object);
    object.RejectOthers();
    return intrinsics;
  }
  throw DataError(fmt::format("{}: no intrinsics; {}", name, kForms));
}

}  // namespace

Intrinsics ParseIntrinsicsText(const std::string& text, const std::string& name,
                               const FrameSize& frame) {
  if (const std::string why = WhyNoText(text); !why.empty())
    throw DataError(fmt::format("{}: {}", name, why));
  std::optional<Intrinsics> intrinsics = formats_internal::FromRsEnumerate(text, name, frame);
  if (!intrinsics) intrinsics = formats_internal::FromPyorbbec(text, name);
  if (!intrinsics) intrinsics = formats_internal::FromPyrealsense(text, name);
  if (!intrinsics) {
    try {
      intrinsics = FromDocument(text, name, frame);
    } catch (const YAML::Exception& error) {
      throw DataError(
          fmt::format("{}: line {}: {}", name, error.mark.line + 1, YamlProblem(error)));
    }
  }
  intrinsics->Validate(name);
  RequireRays(*intrinsics, name);
  return *intrinsics;
}

Intrinsics ReadIntrinsicsFile(const std::filesystem::path& path, const FrameSize& frame) {
  return ParseIntrinsicsText(ReadFile(path, kMaxTextBytes), path.string(), frame);
}

std::string WhyNoText(const std::string& text) {
  const std::string begin = text.substr(0, 2);
  if (begin == "\xff\xfe" || begin == "\xfe\xff")
    return "its text is UTF-16, as PowerShell writes it; save it as UTF-8";
  if (text.find('\0') != std::string::npos)
    return "it is binary, or text of another kind than UTF-8; save it as UTF-8";
  std::string_view view = text;
  if (view.substr(0, 3) == "\xef\xbb\xbf") view.remove_prefix(3);
  view.remove_prefix(std::min(view.find_first_not_of(kBlanks), view.size()));
  if (view.substr(0, 5) == "<?xml" || view.substr(0, 15) == "<opencv_storage")
    return "it is XML, which is not read; write YAML or JSON (OpenCV does for a name that ends in "
           ".yaml)";
  return "";
}

bool LooksLikeIntrinsics(const std::string& text) {
  if (text.find("Intrinsic of \"Depth\"") != std::string::npos ||
      text.find("<OBCameraParam") != std::string::npos)
    return true;
  const std::string_view view = text;
  // pyrealsense2's `]  f[`, and a key, perhaps in quotes, before a colon.
  for (std::size_t at = view.find("f["); at != view.npos; at = view.find("f[", at + 1)) {
    const std::string_view before = WithoutBlanksBehind(view.substr(0, at));
    if (before.size() < at && EndsWith(before, "]")) return true;
  }
  for (std::size_t at = view.find(':'); at != view.npos; at = view.find(':', at + 1)) {
    std::string_view key = WithoutBlanksBehind(view.substr(0, at));
    if (EndsWith(key, "\"")) key.remove_suffix(1);
    for (const std::string_view word : kTellingKeys) {
      if (EndsWith(key, word) &&
          (key.size() == word.size() || !IsOfWord(key[key.size() - word.size() - 1])))
        return true;
    }
  }
  return false;
}

}  // namespace volalign
