#include "infer/io/capture.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/file_util.h"
#include "core/image_io.h"
#include "core/strict_json.h"

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

/// Per pixel the lower median of the non-zero values of all frames.
Image16 MedianOfFrames(const std::vector<Image16>& frames) {
  if (frames.size() == 1) return frames.front();
  Image16 median(frames.front().width(), frames.front().height());
  std::vector<std::uint16_t> values;
  for (std::size_t i = 0; i < median.size(); ++i) {
    values.clear();
    for (const Image16& frame : frames) {
      if (frame[i] > 0) values.push_back(frame[i]);
    }
    if (values.empty()) continue;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    median[i] = *middle;
  }
  return median;
}

SensorFrame ParseSensor(const JsonObject& object, const std::filesystem::path& folder,
                        std::optional<double> common_scale) {
  SensorFrame frame;
  frame.name = object.Text("name");
  const bool plain = !frame.name.empty() && frame.name != "." && frame.name != ".." &&
                     frame.name != "overview" && frame.name != "merged" &&
                     frame.name.find_first_of("/\\") == std::string::npos;
  if (!plain) {
    throw DataError(
        fmt::format("{}: the name \"{}\" has to serve as a file name, beside overview and merged: "
                    "use another plain word",
                    object.where(), frame.name));
  }
  const std::string where = object.Renamed(fmt::format("sensor \"{}\"", frame.name));

  const Json& depth = object.Get("depth");
  if (depth.is_string()) {
    frame.depth_files = {depth.get<std::string>()};
  } else {
    frame.depth_files = object.Texts("depth");
  }
  if (frame.depth_files.empty()) {
    throw DataError(fmt::format("{}: depth is an empty list; name at least one depth file", where));
  }
  frame.intrinsics = ParseIntrinsics(object.Child("intrinsics"));
  frame.quarter_turns = ParseTurns(object);
  if (object.Has("serial")) frame.serial = object.Text("serial");
  if (object.Has("depth_scale")) {
    frame.depth_scale = object.Number("depth_scale");
  } else if (common_scale) {
    frame.depth_scale = *common_scale;
  } else {
    throw DataError(fmt::format(
        "{}: no depth_scale; give metres per unit for the capture or the sensor (0.001 for mm)",
        where));
  }
  if (!(frame.depth_scale > 0)) {
    throw DataError(
        fmt::format("{}: depth_scale = {} violates depth_scale > 0", where, frame.depth_scale));
  }
  object.RejectOthers();

  std::vector<Image16> images;
  for (const std::string& file : frame.depth_files) {
    const std::filesystem::path path = folder / file;
    try {
      images.push_back(ReadDepthFile(path));
    } catch (const IoError& error) {
      throw IoError(fmt::format("{}: {}", where, error.what()));
    } catch (const DataError& error) {
      throw DataError(fmt::format("{}: {}", where, error.what()));
    }
    const Image16& image = images.back();
    if (image.width() != frame.intrinsics.width || image.height() != frame.intrinsics.height) {
      throw DataError(fmt::format(
          "{}: {} is {}x{} but the intrinsics are for {}x{}; give those of this resolution", where,
          path.string(), image.width(), image.height(), frame.intrinsics.width,
          frame.intrinsics.height));
    }
  }
  frame.depth = ToMetres(MedianOfFrames(images), frame.depth_scale);
  return frame;
}

}  // namespace

Capture ReadCapture(const std::filesystem::path& path) {
  const std::string name = path.string();
  const Json document = ParseStrictJson(ReadFile(path), name);
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
    const JsonObject truth = root.Child("ground_truth");
    for (SensorFrame& frame : capture.sensors) {
      if (!truth.Has(frame.name)) continue;
      frame.ground_truth = PoseFromRows(
          truth.Matrix(frame.name), fmt::format("{}: ground_truth of \"{}\"", name, frame.name));
    }
    truth.RejectOthers();
  }
  root.RejectOthers();
  return capture;
}

}  // namespace volalign
