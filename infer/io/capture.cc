#include "infer/io/capture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/file_util.h"
#include "core/image_io.h"
#include "core/statistics.h"
#include "core/strict_json.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

using Json = nlohmann::json;

int ParseTurns(const JsonObject& object) {
  if (!object.Has("quarter_turns")) return kAutoTurns;
  const Json& value = object.Get("quarter_turns");
  if (value.is_string() && value.get<std::string>() == "auto") return kAutoTurns;
  if (value.is_number_integer()) {
    const auto turns = value.get<std::int64_t>();
    if (turns >= 0 && turns <= 3) return static_cast<int>(turns);
  }
  throw DataError(fmt::format("{}: quarter_turns = {} is neither 0, 1, 2, 3 nor \"auto\"",
                              object.where(), value.dump()));
}

/// What several frames say about one pixel, in their units.
struct PixelMean {
  double value = 0, sigma = 0;
};

/// `values`: not zero. `jump`: how far two values of one surface may be apart.
PixelMean MeanOf(const std::vector<std::uint16_t>& values, double jump) {
  constexpr double kWithin = 0.68;      // share of the values, of a normal distribution's one sigma
  constexpr double kFar = 3;            // spreads, of a value that does not count
  constexpr double kLeastSpread = 0.3;  // steps of one unit have a standard deviation of 0.29
  if (values.empty()) return {};
  const double middle = Quantile(values, 0.5);
  std::vector<double> deviations;
  deviations.reserve(values.size());
  for (const std::uint16_t value : values) deviations.push_back(std::abs(value - middle));
  const double spread = std::max(kLeastSpread, NearestQuantile(deviations, kWithin));
  const double gate = std::min(std::max(1.0, kFar * spread), jump);
  double sum = 0, count = 0;
  for (const std::uint16_t value : values) {
    if (std::abs(value - middle) > gate) continue;
    sum += value;
    ++count;
  }
  return {sum / count, spread / std::sqrt(static_cast<double>(values.size()))};
}

/// Sets the frame's depth, and its standard error where there is more than one image.
void SetDepth(const std::vector<Image16>& images, SensorFrame* frame) {
  const double scale = frame->depth_scale;
  frame->depth = ToMetres(images.front(), scale);
  if (images.size() == 1) return;
  frame->depth_sigma = Image<float>(frame->depth.width(), frame->depth.height(), 0.0f);
  std::vector<std::uint16_t> values;
  for (std::size_t i = 0; i < frame->depth.size(); ++i) {
    values.clear();
    for (const Image16& image : images) {
      if (image[i] > 0) values.push_back(image[i]);
    }
    const double near = values.empty() ? 0 : scale * Quantile(values, 0.5);
    const PixelMean mean = MeanOf(values, DepthJump(near) / scale);
    frame->depth[i] = static_cast<float>(scale * mean.value);
    frame->depth_sigma[i] = static_cast<float>(scale * mean.sigma);
  }
}

std::string ParseName(const JsonObject& object) {
  std::string name = object.Text("name");
  if (!IsFileName(name)) {
    throw DataError(
        fmt::format("{}: the name \"{}\" has to serve as a file name, beside overview and merged: "
                    "use another plain word",
                    object.where(), name));
  }
  return name;
}

/// Any text serves as a kind of device; a control character in it is an accident, and would spoil
/// the printed report.
std::string ParseKind(const JsonObject& object) {
  if (!object.Has("sensor")) return "";
  std::string kind = object.Text("sensor");
  const auto is_control = [](char c) { return std::iscntrl(static_cast<unsigned char>(c)) != 0; };
  if (std::any_of(kind.begin(), kind.end(), is_control)) {
    throw DataError(fmt::format(
        "{}: sensor = {} has a control character; name the kind of device in plain text",
        object.where(), Json(kind).dump()));
  }
  return kind;
}

std::vector<std::string> ParseDepthFiles(const JsonObject& object) {
  if (object.Get("depth").is_string()) return {object.Text("depth")};
  std::vector<std::string> files = object.Texts("depth");
  if (files.empty()) {
    throw DataError(
        fmt::format("{}: depth is an empty list; name at least one depth file", object.where()));
  }
  return files;
}

double ParseDepthScale(const JsonObject& object, std::optional<double> common_scale) {
  if (!object.Has("depth_scale") && !common_scale) {
    throw DataError(fmt::format(
        "{}: no depth_scale; give metres per unit for the capture or the sensor (0.001 for mm)",
        object.where()));
  }
  const double scale = object.Has("depth_scale") ? object.Number("depth_scale") : *common_scale;
  if (!(scale > 0)) {
    throw DataError(
        fmt::format("{}: depth_scale = {} violates depth_scale > 0", object.where(), scale));
  }
  return scale;
}

/// One depth file of a sensor, of its intrinsics' size.
Image16 ReadFrame(const std::filesystem::path& path, const Intrinsics& intrinsics,
                  const std::string& where) {
  Image16 image;
  try {
    image = ReadDepthFile(path);
  } catch (const IoError& error) {
    throw IoError(fmt::format("{}: {}; depth paths are relative to the capture's folder", where,
                              error.what()));
  } catch (const DataError& error) {
    throw DataError(fmt::format("{}: {}", where, error.what()));
  }
  if (image.width() != intrinsics.width || image.height() != intrinsics.height) {
    throw DataError(fmt::format(
        "{}: {} is {}x{} but the intrinsics are for {}x{}; give those of this resolution", where,
        path.string(), image.width(), image.height(), intrinsics.width, intrinsics.height));
  }
  return image;
}

SensorFrame ParseSensor(const JsonObject& object, const std::filesystem::path& folder,
                        std::optional<double> common_scale) {
  SensorFrame frame;
  frame.name = ParseName(object);
  const std::string where = object.Renamed(fmt::format("sensor \"{}\"", frame.name));
  frame.depth_files = ParseDepthFiles(object);
  frame.intrinsics = ParseIntrinsics(object.Child("intrinsics"));
  frame.quarter_turns = ParseTurns(object);
  frame.sensor = ParseKind(object);
  if (object.Has("serial")) frame.serial = object.Text("serial");
  frame.depth_scale = ParseDepthScale(object, common_scale);
  object.RejectOthers();

  std::vector<Image16> images;
  for (const std::string& file : frame.depth_files) {
    images.push_back(ReadFrame(folder / file, frame.intrinsics, where));
  }
  SetDepth(images, &frame);
  return frame;
}

/// Gives the sensors the poses that `truth` has for them.
void ParseGroundTruth(const JsonObject& truth, const std::string& name,
                      std::vector<SensorFrame>* sensors) {
  for (SensorFrame& frame : *sensors) {
    if (!truth.Has(frame.name)) continue;
    frame.ground_truth = PoseFromRows(truth.Matrix(frame.name),
                                      fmt::format("{}: ground_truth of \"{}\"", name, frame.name));
  }
  truth.RejectOthers();
}

std::string ReadCaptureText(const std::filesystem::path& path) {
  try {
    return ReadFile(path);
  } catch (const IoError& error) {
    throw IoError(
        fmt::format("{}; give a capture.json, which docs/formats.md describes", error.what()));
  }
}

}  // namespace

std::vector<Still> StillsOf(std::vector<Capture> captures) {
  const auto name_all = [&](const auto& name_of) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < captures.size(); ++i) names.push_back(name_of(i));
    return names;
  };
  const auto serve = [](const std::vector<std::string>& names) {
    return std::set<std::string>(names.begin(), names.end()).size() == names.size() &&
           std::all_of(names.begin(), names.end(), IsFileName);
  };
  std::vector<std::string> names = {""};
  if (captures.size() > 1) {
    names = name_all([&](std::size_t i) { return captures[i].path.stem().string(); });
    if (!serve(names)) {
      names = name_all([&](std::size_t i) {
        return std::filesystem::absolute(captures[i].path).parent_path().filename().string();
      });
    }
    if (!serve(names))
      names = name_all([](std::size_t i) { return fmt::format("still_{}", i + 1); });
  }
  std::vector<Still> stills;
  for (std::size_t i = 0; i < captures.size(); ++i)
    stills.push_back({names[i], std::move(captures[i].sensors)});
  return stills;
}

bool IsFileName(const std::string& name) {
  return !name.empty() && name != "." && name != ".." && name != "overview" && name != "merged" &&
         name.find_first_of("/\\") == std::string::npos;
}

Capture ReadCapture(const std::filesystem::path& path) {
  const std::string name = path.string();
  const Json document = ParseStrictJson(ReadCaptureText(path), name);
  const JsonObject root(document, name);

  if (root.Has("format") && root.Text("format") != kCaptureFormat) {
    throw DataError(fmt::format("{}: format \"{}\" is unknown; this version reads \"{}\"", name,
                                root.Text("format"), kCaptureFormat));
  }
  Capture capture;
  capture.path = path;
  const std::filesystem::path folder = path.parent_path();
  std::optional<double> scale;
  if (root.Has("depth_scale")) scale = root.Number("depth_scale");
  if (root.Has("structure")) capture.structure = folder / root.Text("structure");

  std::set<std::string> names;
  for (const JsonObject& object : root.Children("sensors")) {
    capture.sensors.push_back(ParseSensor(object, folder, scale));
    const std::string& sensor = capture.sensors.back().name;
    if (!names.insert(sensor).second) {
      throw DataError(
          fmt::format("{}: two sensors are named \"{}\"; names must be unique", name, sensor));
    }
  }
  if (capture.sensors.empty()) {
    throw DataError(fmt::format("{}: sensors is empty; list at least one sensor", name));
  }
  if (root.Has("ground_truth")) {
    ParseGroundTruth(root.Child("ground_truth"), name, &capture.sensors);
  }
  root.RejectOthers();
  return capture;
}

}  // namespace volalign
