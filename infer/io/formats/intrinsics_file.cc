#include "infer/io/formats/intrinsics_file.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <optional>
#include <regex>
#include <sstream>
#include <vector>

#include "core/error.h"
#include "core/file_util.h"

namespace volalign {

namespace {

constexpr std::uint64_t kMaxFileBytes = 1 << 24;
constexpr char kForms[] =
    "expected volalign's keys (width, height, fx, fy, cx, cy), Open3D's intrinsic_matrix, OpenCV's "
    "or ROS's camera_matrix, RealSense's ppx and coeffs, or the Azure Kinect's "
    "CalibrationInformation";

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
    throw DataError(
        fmt::format("{}: {} is missing: the intrinsics hold for one image size and lens, which "
                    "have to be stated",
                    name, *keys.begin()));
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

/// Coefficients in OpenCV's order: more than eight only if the rest is 0.
std::vector<double> Distortion(std::vector<double> numbers, const std::string& name) {
  if (numbers.size() > 8) {
    if (std::any_of(numbers.begin() + 8, numbers.end(), [](double x) { return x != 0; })) {
      throw DataError(fmt::format(
          "{}: {} distortion coefficients, of which those after the eighth (thin prism, tilt) are "
          "not 0; calibrate with at most eight",
          name, numbers.size()));
    }
    numbers.resize(8);
  }
  return numbers;
}

std::string Lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  std::replace(text.begin(), text.end(), '-', '_');
  std::replace(text.begin(), text.end(), ' ', '_');
  return text;
}

/// The coefficients of a lens that its file gives a name.
std::vector<double> NamedLens(const std::string& model, const std::vector<double>& numbers,
                              const std::string& name) {
  const bool is_zero = std::all_of(numbers.begin(), numbers.end(), [](double x) { return x == 0; });
  const std::string word = Lower(model);
  for (const char* known : {"plumb_bob", "rational_polynomial", "brown_conrady",
                            "distortion.brown_conrady", "rs2_distortion_brown_conrady"}) {
    if (word == known || word.empty()) return Distortion(numbers, name);
  }
  // Without coefficients every model is that of a rectified image; RealSense prints five zeros.
  if (is_zero) return std::vector<double>(numbers.empty() ? 0 : 5, 0.0);
  throw DataError(fmt::format(
      "{}: the lens model \"{}\" is not OpenCV's (plumb_bob, rational_polynomial, Brown Conrady); "
      "rectify the frames, or calibrate with one of these",
      name, model));
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
  Intrinsics intrinsics;
  intrinsics.width = Required(map, {"image_width", "width"}, name).as<int>();
  intrinsics.height = Required(map, {"image_height", "height"}, name).as<int>();
  intrinsics.fx = k[0];
  intrinsics.cx = k[2];
  intrinsics.fy = k[4];
  intrinsics.cy = k[5];
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
  Intrinsics intrinsics;
  intrinsics.width = Required(map, {"width"}, name).as<int>();
  intrinsics.height = Required(map, {"height"}, name).as<int>();
  intrinsics.fx = k[0];
  intrinsics.fy = k[4];
  intrinsics.cx = k[6];
  intrinsics.cy = k[7];
  return intrinsics;
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

/// A mode of the Azure Kinect's depth camera: its frame is cut out of the chip, whole or binned, of
/// `chip` pixels a side, at (left, top).
struct KinectMode {
  int width, height, chip, left, top;
};
constexpr KinectMode kKinectModes[] = {{320, 288, 512, 96, 90},
                                       {640, 576, 1024, 192, 180},
                                       {512, 512, 512, 0, 0},
                                       {1024, 1024, 1024, 0, 0}};

YAML::Node KinectDepthCamera(const YAML::Node& root, const std::string& name) {
  for (const YAML::Node& camera : root["CalibrationInformation"]["Cameras"]) {
    const std::string purpose = camera["Purpose"] ? camera["Purpose"].as<std::string>() : "";
    const std::string location = camera["Location"] ? camera["Location"].as<std::string>() : "";
    if (purpose == "CALIBRATION_CameraPurposeDepth" || location == "CALIBRATION_CameraLocationD0")
      return camera;
  }
  throw DataError(name + ": no camera of CalibrationInformation is the depth camera");
}

Intrinsics FromKinect(const YAML::Node& root, const std::string& name, const FrameSize& frame) {
  const KinectMode* mode = std::find_if(
      std::begin(kKinectModes), std::end(kKinectModes),
      [&](const KinectMode& m) { return m.width == frame.width && m.height == frame.height; });
  if (mode == std::end(kKinectModes)) {
    throw DataError(fmt::format(
        "{}: an Azure Kinect has no depth frames of {}x{} (but 320x288, 640x576, 512x512 and "
        "1024x1024), so that its raw calibration does not hold for this one",
        name, frame.width, frame.height));
  }
  const YAML::Node given = KinectDepthCamera(root, name)["Intrinsics"];
  const std::string type = given["ModelType"].as<std::string>();
  const std::vector<double> p = Numbers(given["ModelParameters"]);
  if (type != "CALIBRATION_LensDistortionModelBrownConrady" || p.size() < 14)
    throw DataError(
        fmt::format("{}: ModelType {} with {} parameters is unknown", name, type, p.size()));
  // cx cy fx fy k1 k2 k3 k4 k5 k6 codx cody p2 p1, the first four as shares of the chip's side.
  if (p[10] != 0 || p[11] != 0)
    throw DataError(name + ": codx and cody, the centre of distortion, are not 0");
  const double chip = mode->chip;
  Intrinsics intrinsics;
  intrinsics.width = mode->width;
  intrinsics.height = mode->height;
  intrinsics.fx = p[2] * chip;
  intrinsics.fy = p[3] * chip;
  intrinsics.cx = p[0] * chip - mode->left - 0.5;
  intrinsics.cy = p[1] * chip - mode->top - 0.5;
  intrinsics.distortion = {p[4], p[5], p[13], p[12], p[6], p[7], p[8], p[9]};
  return intrinsics;
}

std::vector<double> NumbersOfText(const std::string& text) {
  std::istringstream stream(text);
  std::vector<double> numbers;
  for (double x; stream >> x;) numbers.push_back(x);
  return numbers;
}

/// "[ 640x480  p[318.5 240.9]  f[383.3 383.3]  Brown Conrady [0 0 0 0 0] ]"
std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name) {
  static const std::regex pattern(
      R"(\[\s*(\d{1,5})x(\d{1,5})\s+p\[(\S+) (\S+)\]\s+f\[(\S+) (\S+)\]\s+([\w ]+?)\s*\[([^\]]*)\]\s*\])");
  std::smatch m;
  if (!std::regex_search(text, m, pattern)) return std::nullopt;
  Intrinsics intrinsics;
  intrinsics.width = std::stoi(m[1]);
  intrinsics.height = std::stoi(m[2]);
  const std::vector<double> k =
      NumbersOfText(m[3].str() + " " + m[4].str() + " " + m[5].str() + " " + m[6].str());
  if (k.size() != 4) throw DataError(name + ": p[...] and f[...] have two numbers each");
  intrinsics.cx = k[0];
  intrinsics.cy = k[1];
  intrinsics.fx = k[2];
  intrinsics.fy = k[3];
  intrinsics.distortion = NamedLens(m[7], NumbersOfText(m[8]), name);
  return intrinsics;
}

/// The text after `key` up to the end of its line.
std::string After(const std::string& block, const std::string& key, const std::string& name) {
  std::smatch m;
  if (!std::regex_search(block, m, std::regex("(?:^|\n)\\s*" + key + ":\\s*([^\n]*)")))
    throw DataError(fmt::format("{}: {} is missing", name, key));
  return m[1];
}

/// The blocks that `rs-enumerate-devices -c` prints: `Intrinsic of "Depth" / 848x480 / {Z16}`.
std::optional<Intrinsics> FromRsEnumerate(const std::string& text, const std::string& name,
                                          const FrameSize& frame) {
  const std::string title = "Intrinsic of \"Depth\"";
  std::size_t at = text.find(title);
  if (at == std::string::npos) return std::nullopt;
  for (; at != std::string::npos; at = text.find(title, at + 1)) {
    const std::string block = text.substr(at, text.find("Intrinsic of", at + 1) - at);
    Intrinsics intrinsics;
    const auto number = [&](const char* key) {
      const std::vector<double> numbers = NumbersOfText(After(block, key, name));
      if (numbers.empty()) throw DataError(fmt::format("{}: {} has no number", name, key));
      return numbers[0];
    };
    intrinsics.width = static_cast<int>(number("Width"));
    intrinsics.height = static_cast<int>(number("Height"));
    if (intrinsics.width != frame.width || intrinsics.height != frame.height) continue;
    intrinsics.cx = number("PPX");
    intrinsics.cy = number("PPY");
    intrinsics.fx = number("Fx");
    intrinsics.fy = number("Fy");
    std::string model = After(block, "Distortion", name);
    model.erase(model.find_last_not_of(" \t\r") + 1);
    intrinsics.distortion = NamedLens(model, NumbersOfText(After(block, "Coeffs", name)), name);
    return intrinsics;
  }
  throw DataError(
      fmt::format("{}: no intrinsics of a depth stream of {}x{}", name, frame.width, frame.height));
}

/// A document without the directive of OpenCV's FileStorage, which yaml-cpp does not know.
YAML::Node Load(const std::string& text) {
  std::size_t begin = 0;
  if (text.compare(0, 5, "%YAML") == 0) begin = std::min(text.find('\n'), text.size());
  return YAML::Load(text.substr(begin));
}

Intrinsics FromDocument(const std::string& text, const std::string& name, const FrameSize& frame) {
  const YAML::Node root = Load(text);
  if (!root.IsMap()) throw DataError(fmt::format("{}: no intrinsics; {}", name, kForms));
  if (root["CalibrationInformation"]) return FromKinect(root, name, frame);
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
  std::optional<Intrinsics> intrinsics = FromRsEnumerate(text, name, frame);
  if (!intrinsics) intrinsics = FromPyrealsense(text, name);
  if (!intrinsics) {
    try {
      intrinsics = FromDocument(text, name, frame);
    } catch (const YAML::Exception& error) {
      throw DataError(fmt::format("{}: line {}: {}", name, error.mark.line + 1, error.msg));
    }
  }
  intrinsics->Validate(name);
  return *intrinsics;
}

Intrinsics ReadIntrinsicsFile(const std::filesystem::path& path, const FrameSize& frame) {
  return ParseIntrinsicsText(ReadFile(path, kMaxFileBytes), path.string(), frame);
}

bool LooksLikeIntrinsics(const std::string& text) {
  static const std::regex words(
      R"re("?\b(CalibrationInformation|intrinsic_matrix|ppx|camera_matrix|cameraMatrix|K|k|fx)\b"?\s*:|Intrinsic of "Depth"|\]\s+f\[)re");
  return std::regex_search(text, words);
}

}  // namespace volalign
