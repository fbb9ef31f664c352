#include "infer/formats/intrinsics_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <initializer_list>
#include <map>
#include <sstream>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "core/config/archive.h"
#include "core/config/bounded_yaml.h"
#include "core/geometry/lens.h"
#include "infer/formats/kinect_calibration.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::formats_internal {

std::vector<double> NamedLens(const std::string& model, std::vector<double> numbers,
                              const std::string& name) {
  const auto is_zero = [](double x) { return x == 0; };
  std::string word = Lower(model);
  std::replace_if(
      word.begin(), word.end(), [](char c) { return c == '-' || c == ' '; }, '_');
  const auto known = {"",
                      "plumb_bob",
                      "rational_polynomial",
                      "brown_conrady",
                      "distortion.brown_conrady",
                      "rs2_distortion_brown_conrady"};
  if (std::find(known.begin(), known.end(), word) == known.end()) {
    // Without coefficients every model is a rectified image; RealSense prints five zeros.
    if (std::all_of(numbers.begin(), numbers.end(), is_zero))
      return std::vector<double>(numbers.empty() ? 0 : 5, 0.0);
    throw DataError(fmt::format(
        "{}: the lens model \"{}\" is not OpenCV's (plumb_bob, rational_polynomial, Brown "
        "Conrady); rectify the frames, or calibrate with one of these",
        name, Shortened(model)));
  }
  if (numbers.size() > 8) {
    if (!std::all_of(numbers.begin() + 8, numbers.end(), is_zero)) {
      throw DataError(fmt::format(
          "{}: {} distortion coefficients, of which those after the eighth (thin prism, tilt) are "
          "not 0; calibrate with at most eight",
          name, numbers.size()));
    }
    numbers.resize(8);
  }
  return numbers;
}

}  // namespace volalign::formats_internal

namespace volalign {

using formats_internal::NamedLens;
using Json = nlohmann::json;

namespace {

constexpr char kBlanks[] = " \t\r\n\v\f";

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

std::string WithoutBlanksAround(std::string_view text) {
  text.remove_prefix(std::min(text.find_first_not_of(kBlanks), text.size()));
  return std::string(WithoutBlanksBehind(text));
}

bool EndsWith(std::string_view text, std::string_view end) {
  return text.size() >= end.size() && text.substr(text.size() - end.size()) == end;
}

bool IsOfWord(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

/// The first of `keys` that the map has; null for none.
const Json* FirstOf(const Json& map, std::initializer_list<const char*> keys) {
  for (const char* key : keys)
    if (const auto found = map.find(key); found != map.end()) return &*found;
  return nullptr;
}

/// `what`: of which it is a number, which may stand in quotes.
double Number(const Json& value, const std::string& what, const std::string& name) {
  if (value.is_number()) return value;
  return poses_internal::ParseNumber(ScalarText(value), fmt::format("{}: {}", name, what));
}

double Required(const Json& map, std::initializer_list<const char*> keys, const std::string& name) {
  if (const Json* const value = FirstOf(map, keys)) return Number(*value, *keys.begin(), name);
  throw DataError(fmt::format(
      "{}: {} is missing; state the image size and the lens for which the intrinsics hold", name,
      *keys.begin()));
}

/// The numbers of 1, [1, 2], [[1], [2]] or {rows, cols, data: [1, 2]}.
std::vector<double> Numbers(const Json& value, const char* what, const std::string& name) {
  if (value.is_object() && value.contains("data")) return Numbers(value["data"], what, name);
  if (!value.is_array()) return {Number(value, what, name)};
  std::vector<double> numbers;
  for (const Json& item : value) {
    const std::vector<double> of_item = Numbers(item, what, name);
    numbers.insert(numbers.end(), of_item.begin(), of_item.end());
  }
  return numbers;
}

/// fx, fy, cx, cy of a camera matrix. Open3D has it column by column, all others row by row.
std::vector<double> OfMatrix(const Json& matrix, bool by_column, const std::string& name) {
  const std::vector<double> numbers = Numbers(matrix, "the camera matrix", name);
  if (numbers.size() != 9)
    throw DataError(fmt::format("{}: a camera matrix of {} numbers, not 9", name, numbers.size()));
  Eigen::Matrix3d k = Eigen::Map<const Eigen::Matrix3d>(numbers.data());
  if (!by_column) k.transposeInPlace();
  if (k(0, 1) != 0 || k(1, 0) != 0 || k(2, 0) != 0 || k(2, 1) != 0 || k(2, 2) != 1) {
    throw DataError(fmt::format("{}: the camera matrix is not {}", name,
                                by_column ? "[fx, 0, 0, 0, fy, 0, cx, cy, 1], column by column as "
                                            "Open3D has it"
                                          : "[fx, 0, cx, 0, fy, cy, 0, 0, 1], row by row"));
  }
  return {k(0, 0), k(1, 1), k(0, 2), k(1, 2)};
}

/// Reads the keys of all programs that state one camera in one map. A lens has its coefficients and
/// the name of its model; `distortion` is either.
Intrinsics FromKeys(const Json& map, const std::string& name) {
  if (!map.is_object()) throw DataError(fmt::format("{}: no intrinsics; {}", name, kForms));
  const auto above = [](const Json& of, const char* key, double most) {
    const Json* const value = FirstOf(of, {key});
    return value && value->is_number() && *value > most;
  };
  for (const char* key : {"binning_x", "binning_y"}) {
    if (above(map, key, 1))
      throw DataError(fmt::format("{}: {} = {}: give the intrinsics of the image as it is stored",
                                  name, key, ScalarText(map[key])));
  }
  if (const Json* const roi = FirstOf(map, {"roi"});
      roi && roi->is_object() && (above(*roi, "x_offset", 0) || above(*roi, "y_offset", 0))) {
    throw DataError(name + ": roi: give the intrinsics of the image as it is stored, cut out");
  }
  const Json* const of_open3d = FirstOf(map, {"intrinsic_matrix"});
  const Json* const matrix =
      of_open3d ? of_open3d
                : FirstOf(map, {"camera_matrix", "cameraMatrix", "K", "k", "intrinsicMatrix"});
  std::vector<double> k;
  if (matrix) {
    k = OfMatrix(*matrix, of_open3d != nullptr, name);
  } else {
    k = {Required(map, {"fx"}, name), Required(map, {"fy"}, name),
         Required(map, {"ppx", "cx"}, name), Required(map, {"ppy", "cy"}, name)};
  }
  Intrinsics intrinsics{
      poses_internal::PixelCount(Required(map, {"image_width", "width"}, name), name),
      poses_internal::PixelCount(Required(map, {"image_height", "height"}, name), name),
      k[0],
      k[1],
      k[2],
      k[3],
      {}};
  const Json* const model =
      FirstOf(map, {matrix ? "distortion_model" : "model", "distortion_model", "distortion"});
  const Json* const lens = FirstOf(map, {"distortion_coefficients", "D", "d", "dist_coeffs",
                                         "distCoeffs", "coeffs", "coefficients", "distortion"});
  const bool is_named = model && !model->is_structured();
  if (lens && !(is_named && lens == model))
    intrinsics.distortion =
        NamedLens(is_named ? ScalarText(*model) : "", Numbers(*lens, "distortion", name), name);
  return intrinsics;
}

// The prints that tools make for people, as maps of RealSense's keys. Null for other texts.
// They throw DataError, which `name` begins, if the text is such a print but cannot be used.

/// The numbers up to the first other word.
std::vector<double> NumbersOfText(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream words(text);
  for (std::string word; words >> word && NumberOf(word);) numbers.push_back(*NumberOf(word));
  return numbers;
}

/// print(profile.intrinsics) of pyrealsense2:
/// "[ 640x480  p[318.5 240.9]  f[383.3 383.3]  Brown Conrady [0 0 0 0 0] ]"
Json OfPyrealsense(const std::string& text, const std::string& name) {
  constexpr std::size_t kLongestPrint = 1000;
  for (std::size_t at = text.find('['); at != std::string::npos; at = text.find('[', at + 1)) {
    // Only a part of the text, so that many open brackets do not each search all of it.
    std::istringstream print(text.substr(at + 1, kLongestPrint));
    std::array<std::string, 8> parts;  // 640, 480  p, 318.5 240.9, f, ... up to the last bracket
    for (std::size_t i = 0; i < parts.size(); ++i) {
      std::getline(print, parts[i], "x[][][]]"[i]);
      parts[i] = WithoutBlanksAround(parts[i]);
    }
    const bool whole =
        print.good() && EndsWith(parts[1], "p") && parts[3] == "f" && parts[7].empty();
    const std::string height =
        whole ? WithoutBlanksAround(parts[1].substr(0, parts[1].size() - 1)) : "";
    if (!NumberOf(parts[0]) || !NumberOf(height)) continue;
    const std::vector<double> c = NumbersOfText(parts[2]), f = NumbersOfText(parts[4]);
    if (c.size() != 2 || f.size() != 2)
      throw DataError(name + ": p[...] and f[...] have two numbers each");
    return {{"width", parts[0]}, {"height", height},
            {"fx", f[0]},        {"fy", f[1]},
            {"ppx", c[0]},       {"ppy", c[1]},
            {"model", parts[5]}, {"coeffs", NumbersOfText(parts[6])}};
  }
  return {};
}

/// The text after `key` up to the end of its line.
std::string After(const std::string& block, const std::string& key, const std::string& name) {
  for (const std::string& line : Split(block, '\n')) {
    const std::string text = WithoutBlanksAround(line);
    if (text.rfind(key + ":", 0) == 0) return WithoutBlanksAround(text.substr(key.size() + 1));
  }
  throw DataError(fmt::format("{}: {} is missing", name, key));
}

/// `rs-enumerate-devices -c` prints blocks that begin `Intrinsic of "Depth" / 848x480 / {Z16}`.
/// Takes the one of the frame's size.
constexpr char kRsTitle[] = "Intrinsic of \"Depth\"";
Json OfRsEnumerate(const std::string& text, const std::string& name, const ImageSize& frame) {
  for (std::size_t at = text.find(kRsTitle); at != std::string::npos;
       at = text.find(kRsTitle, at + 1)) {
    const std::string block = text.substr(at, text.find("Intrinsic of", at + 1) - at);
    if (After(block, "Width", name) != std::to_string(frame.width) ||
        After(block, "Height", name) != std::to_string(frame.height))
      continue;
    Json map;
    for (const char* key : {"Width", "Height", "Fx", "Fy", "PPX", "PPY"})
      map[Lower(key)] = After(block, key, name);
    map["model"] = After(block, "Distortion", name);
    map["coeffs"] = NumbersOfText(After(block, "Coeffs", name));
    return map;
  }
  throw DataError(
      fmt::format("{}: no intrinsics of a depth stream of {}x{}", name, frame.width, frame.height));
}

/// "< fx=504.5 fy=504.5 >" behind the word: the values by their keys.
std::map<std::string, std::string> ValuesBehind(const std::string& text, const std::string& word,
                                                const std::string& name) {
  const std::size_t at = text.find(word), open = text.find('<', at), close = text.find('>', at);
  if (at == std::string::npos || open == std::string::npos || close < open)
    throw DataError(fmt::format("{}: {} is missing", name, word));
  std::string part = text.substr(open + 1, close - open - 1);
  std::replace(part.begin(), part.end(), ',', ' ');
  std::map<std::string, std::string> values;
  std::istringstream words(part);
  for (std::string pair; words >> pair;) {
    const std::size_t equals = std::min(pair.find('='), pair.size() - 1);
    values[pair.substr(0, equals)] = pair.substr(equals + 1);
  }
  return values;
}

/// The depth camera in pyorbbecsdk's print of OBCameraParam, whose lens is given as k1 ... k6 p1
/// p2.
Json OfPyorbbec(const std::string& text, const std::string& name) {
  const auto camera = ValuesBehind(text, "depth_intrinsic", name);
  const auto lens = ValuesBehind(text, "depth_distortion", name);
  Json map;
  for (const char* key : {"width", "height", "fx", "fy", "cx", "cy"}) {
    if (const auto found = camera.find(key); found != camera.end()) map[key] = found->second;
  }
  for (const char* key : {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}) {
    const auto found = lens.find(key);
    if (found == lens.end() || !NumberOf(found->second))
      throw DataError(fmt::format("{}: {} has no number", name, key));
    map["coeffs"].push_back(found->second);
  }
  return map;
}

Json OfPrint(const std::string& text, const std::string& name, const ImageSize& frame) {
  if (text.find(kRsTitle) != std::string::npos) return OfRsEnumerate(text, name, frame);
  if (text.find("OBCameraParam") != std::string::npos) return OfPyorbbec(text, name);
  return OfPyrealsense(text, name);
}

/// A calibration of DepthAI: `cameraData` is a list of [socket, camera]. Depth is computed from
/// rectified pictures, with the right camera's matrix (H1 = M2 R1 M1^-1, H2 = M2 R2 M2^-1 in
/// Luxonis' calibration_utils.py), and aligned to that camera unless the pipeline says otherwise.
Intrinsics FromDepthAi(const Json& root, const std::string& name, const ImageSize& frame) {
  constexpr int kRight = 2;  // CameraBoardSocket::CAM_C
  for (const Json& pair : root["cameraData"]) {
    if (!pair.is_array() || pair.size() != 2 || pair[0] != kRight) continue;
    Intrinsics given = FromKeys(pair[1], name);
    given.distortion.assign(5, 0.0);
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

Intrinsics FromDocument(const std::string& text, const std::string& name, const ImageSize& frame) {
  // yaml-cpp does not know the directive of OpenCV's FileStorage.
  const std::size_t begin = text.compare(0, 5, "%YAML") == 0 ? text.find('\n') : 0;
  const Json root = YamlTree(text.substr(std::min(begin, text.size())), name);
  if (FirstOf(root, {"CalibrationInformation"}))
    return formats_internal::KinectDepthIntrinsics(ObjectReader(root, name), frame);
  if (FirstOf(root, {"cameraData"})) return FromDepthAi(root, name, frame);
  if (const Json* const of = FirstOf(root, {"intrinsic"}); of && of->is_object())
    return FromKeys(*of, name);
  if (FirstOf(root, {"intrinsic_matrix", "ppx", "camera_matrix", "cameraMatrix", "K", "k"}))
    return FromKeys(root, name);
  if (FirstOf(root, {"fx"})) return ReadDescribed<Intrinsics>(text, name);
  throw DataError(fmt::format("{}: no intrinsics; {}", name, kForms));
}

}  // namespace

Intrinsics ParseIntrinsicsText(const std::string& text, const std::string& name,
                               const ImageSize& frame) {
  if (const std::string why = WhyNoText(text); !why.empty())
    throw DataError(fmt::format("{}: {}", name, why));
  const Json print = OfPrint(text, name, frame);
  const Intrinsics intrinsics =
      print.is_null() ? FromDocument(text, name, frame) : FromKeys(print, name);
  intrinsics.Validate(name);
  RequireRays(intrinsics, name);
  return intrinsics;
}

Intrinsics ReadIntrinsicsFile(const std::filesystem::path& path, const ImageSize& frame) {
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
  if (text.find(kRsTitle) != std::string::npos || text.find("<OBCameraParam") != std::string::npos)
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
