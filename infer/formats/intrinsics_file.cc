#include "infer/formats/intrinsics_file.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <locale>
#include <map>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"
#include "core/geometry/lens.h"
#include "infer/formats/kinect_calibration.h"

namespace volalign::formats_internal {

constexpr char kBlanks[] = " \t\r\n\v\f";

namespace {

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

}  // namespace

std::vector<double> NamedLens(const std::string& model, const std::vector<double>& numbers,
                              const std::string& name) {
  const bool is_zero = std::all_of(numbers.begin(), numbers.end(), [](double x) { return x == 0; });
  std::string word = Lower(model);
  std::replace_if(
      word.begin(), word.end(), [](char c) { return c == '-' || c == ' '; }, '_');
  for (const char* known : {"plumb_bob", "rational_polynomial", "brown_conrady",
                            "distortion.brown_conrady", "rs2_distortion_brown_conrady"}) {
    if (word == known || word.empty()) return Distortion(numbers, name);
  }
  // Without coefficients every model is a rectified image; RealSense prints five zeros.
  if (is_zero) return std::vector<double>(numbers.empty() ? 0 : 5, 0.0);
  throw DataError(fmt::format(
      "{}: the lens model \"{}\" is not OpenCV's (plumb_bob, rational_polynomial, Brown Conrady); "
      "rectify the frames, or calibrate with one of these",
      name, Shortened(model)));
}

namespace {

constexpr std::size_t kLongestPrint = 1000;

/// The numbers up to the first other word.
std::vector<double> NumbersOfText(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::optional<double> number = NumberOf(word);
    if (!number) break;
    numbers.push_back(*number);
  }
  return numbers;
}

std::string WithoutBlanksAround(const std::string& text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

/// The text after `key` up to the end of its line.
std::string After(const std::string& block, const std::string& key, const std::string& name) {
  for (const std::string& line : Split(block, '\n')) {
    const std::string text = WithoutBlanksAround(line);
    if (text.rfind(key + ":", 0) == 0) return WithoutBlanksAround(text.substr(key.size() + 1));
  }
  throw DataError(fmt::format("{}: {} is missing", name, key));
}

/// "640x480  p[318.5 240.9]  f[383.3 384.4]  Brown Conrady [0.1 0 0 0.2 0]", in brackets; the first
/// bracket is taken already.
struct Printed {
  int width = 0, height = 0;
  std::string centre, focal, model, distortion;
};
std::optional<Printed> TakePrinted(const std::string& text) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  Printed printed;
  char x = 0, end = 0;
  std::string p, f;
  const auto until = [&](char mark, std::string* part) {
    return static_cast<bool>(std::getline(stream, *part, mark));
  };
  const bool whole = stream >> printed.width >> x >> printed.height && until('[', &p) &&
                     until(']', &printed.centre) && until('[', &f) && until(']', &printed.focal) &&
                     until('[', &printed.model) && until(']', &printed.distortion) && stream >> end;
  if (!whole || x != 'x' || WithoutBlanksAround(p) != "p" || WithoutBlanksAround(f) != "f" ||
      end != ']')
    return std::nullopt;
  return printed;
}

}  // namespace

std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name) {
  for (std::size_t at = text.find('['); at != std::string::npos; at = text.find('[', at + 1)) {
    // Only a part of the text, so that many open brackets do not each search all of it.
    const std::optional<Printed> printed = TakePrinted(text.substr(at + 1, kLongestPrint));
    if (!printed) continue;
    const std::vector<double> c = NumbersOfText(printed->centre), f = NumbersOfText(printed->focal);
    if (c.size() != 2 || f.size() != 2)
      throw DataError(name + ": p[...] and f[...] have two numbers each");
    return Intrinsics{
        printed->width,
        printed->height,
        f[0],
        f[1],
        c[0],
        c[1],
        NamedLens(WithoutBlanksAround(printed->model), NumbersOfText(printed->distortion), name)};
  }
  return std::nullopt;
}

std::optional<Intrinsics> FromRsEnumerate(const std::string& text, const std::string& name,
                                          const FrameSize& frame) {
  const std::string title = "Intrinsic of \"Depth\"";
  std::size_t at = text.find(title);
  if (at == std::string::npos) return std::nullopt;
  for (; at != std::string::npos; at = text.find(title, at + 1)) {
    const std::string block = text.substr(at, text.find("Intrinsic of", at + 1) - at);
    const auto number = [&](const char* key) {
      const std::vector<double> numbers = NumbersOfText(After(block, key, name));
      if (numbers.empty()) throw DataError(fmt::format("{}: {} has no number", name, key));
      return numbers[0];
    };
    if (number("Width") != frame.width || number("Height") != frame.height) continue;
    const std::string model = After(block, "Distortion", name);
    return Intrinsics{frame.width,
                      frame.height,
                      number("Fx"),
                      number("Fy"),
                      number("PPX"),
                      number("PPY"),
                      NamedLens(model, NumbersOfText(After(block, "Coeffs", name)), name)};
  }
  throw DataError(
      fmt::format("{}: no intrinsics of a depth stream of {}x{}", name, frame.width, frame.height));
}

namespace {

/// "< fx=504.5 fy=504.5 >" behind the word: the values by their keys.
std::map<std::string, double> ValuesBehind(const std::string& text, const std::string& word,
                                           const std::string& name) {
  const std::size_t at = text.find(word), open = text.find('<', at), close = text.find('>', at);
  if (at == std::string::npos || open == std::string::npos || close < open)
    throw DataError(fmt::format("{}: {} is missing", name, word));
  std::string part = text.substr(open + 1, close - open - 1);
  std::replace(part.begin(), part.end(), ',', ' ');
  std::map<std::string, double> values;
  std::istringstream words(part);
  for (std::string pair; words >> pair;) {
    const std::size_t equals = std::min(pair.find('='), pair.size() - 1);
    if (const std::optional<double> number = NumberOf(pair.substr(equals + 1)))
      values[pair.substr(0, equals)] = *number;
  }
  return values;
}

}  // namespace

std::optional<Intrinsics> FromPyorbbec(const std::string& text, const std::string& name) {
  if (text.find("OBCameraParam") == std::string::npos) return std::nullopt;
  const auto camera = ValuesBehind(text, "depth_intrinsic", name);
  const auto lens = ValuesBehind(text, "depth_distortion", name);
  const auto value = [&](const std::map<std::string, double>& of, const char* key) {
    const auto found = of.find(key);
    if (found == of.end()) throw DataError(fmt::format("{}: {} has no number", name, key));
    return found->second;
  };
  const auto pixels = [&](const char* key) {
    const double number = value(camera, key);
    if (!(number >= 1 && number <= 1e5))
      throw DataError(fmt::format("{}: {} = {} is no number of pixels", name, key, number));
    return static_cast<int>(number);
  };
  Intrinsics intrinsics{pixels("width"),
                        pixels("height"),
                        value(camera, "fx"),
                        value(camera, "fy"),
                        value(camera, "cx"),
                        value(camera, "cy"),
                        {}};
  for (const char* key : {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"})
    intrinsics.distortion.push_back(value(lens, key));
  return intrinsics;
}

}  // namespace volalign::formats_internal

namespace volalign {

using formats_internal::kBlanks, formats_internal::NamedLens;

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
  if (root["CalibrationInformation"])
    return formats_internal::KinectDepthIntrinsics(root, name, frame);
  if (root["cameraData"]) return FromDepthAi(root, name, frame);
  if (root["intrinsic_matrix"]) return FromOpen3d(root, name);
  if (root["intrinsic"] && root["intrinsic"].IsMap()) return FromOpen3d(root["intrinsic"], name);
  if (root["ppx"]) return FromRealSense(root, name);
  if (const YAML::Node matrix = FirstOf(root, {"camera_matrix", "cameraMatrix", "K", "k"}))
    return FromMatrix(root, matrix, name);
  if (root["fx"]) return ReadDescribed<Intrinsics>(text, name);
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
      throw DataError(YamlProblemIn(name, error));
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
