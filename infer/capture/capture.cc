#include "infer/capture/capture.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/geometry/lens.h"
#include "core/json/json_archive.h"
#include "infer/capture/mean_depth.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/intrinsics_file.h"
#include "infer/formats/read_budget.h"
#include "infer/formats/recording.h"

namespace volalign {

namespace {

using Json = nlohmann::json;

constexpr int kMostFrames = 1000;  // of a recording
constexpr std::size_t kMostSensors = 1000;

int ParseTurns(const ObjectReader& object) {
  if (!object.Has("quarter_turns")) return kAutoTurns;
  const Json& value = object.Get("quarter_turns");
  if (value.is_string() && value.get<std::string>() == "auto") return kAutoTurns;
  if (value.is_number_integer()) {
    const auto turns = value.get<std::int64_t>();
    if (turns >= 0 && turns <= 3) return static_cast<int>(turns);
  }
  throw DataError(fmt::format("{}: quarter_turns = {} is neither 0, 1, 2, 3 nor \"auto\"",
                              object.where(), ShownJson(value)));
}

std::string ParseName(const ObjectReader& object) {
  std::string name = object.Text("name");
  if (!IsFileName(name)) {
    throw DataError(
        fmt::format("{}: the name \"{}\" cannot be a file name; use a plain word of at most "
                    "{} bytes, but not overview or merged, without \"-\" at its beginning",
                    object.where(), Shortened(name, kMostNameBytes), kMostNameBytes));
  }
  return name;
}

/// Any text that can be printed serves as a kind, a number or a renderer.
std::string ParsePlainText(const ObjectReader& object, const std::string& key) {
  if (!object.Has(key)) return "";
  std::string text = object.Text(key);
  RequirePlainText(text, object.Place(key));
  return text;
}

std::vector<std::string> ParseDepthFiles(const ObjectReader& object) {
  if (object.Get("depth").is_string()) return {object.Text("depth")};
  std::vector<std::string> files = object.Read<std::vector<std::string>>("depth");
  if (files.empty()) {
    throw DataError(
        fmt::format("{}: depth is an empty list; name at least one depth file", object.where()));
  }
  return files;
}

/// Runs `read` and puts the sensor's name before its errors.
template <class Read>
auto ReadingFor(const std::string& where, const Read& read) {
  try {
    return read();
  } catch (const IoError& error) {
    throw IoError(fmt::format("{}: {}; depth paths are relative to the capture's folder", where,
                              error.what()));
  } catch (const DataError& error) {
    throw DataError(fmt::format("{}: {}", where, error.what()));
  }
}

/// The chosen stream of a recording.
RecordedDepth ReadRecordedDepth(const ObjectReader& object, const std::filesystem::path& path,
                                ReadBudget* budget) {
  const int frames = object.Has("frames") ? object.Read<int>("frames") : kDefaultFrames;
  if (frames < 1 || frames > kMostFrames) {
    throw DataError(fmt::format("{}: frames = {} violates 1 <= frames <= {}", object.where(),
                                frames, kMostFrames));
  }
  std::vector<RecordedDepth> streams =
      ReadingFor(object.where(), [&] { return ReadRecording(path, frames, budget); });
  std::vector<std::string> names;
  for (const RecordedDepth& stream : streams) names.push_back(stream.stream);
  const std::string all = Shortened(fmt::format("{}", fmt::join(names, ", ")));
  std::size_t chosen = 0;
  if (object.Has("stream")) {
    const std::string wanted = object.Text("stream");
    chosen =
        static_cast<std::size_t>(std::find(names.begin(), names.end(), wanted) - names.begin());
    if (chosen == names.size()) {
      throw DataError(fmt::format("{}: {} has no depth stream \"{}\", but {}", object.where(),
                                  path.string(), Shortened(wanted), all));
    }
  } else if (streams.size() > 1) {
    throw DataError(fmt::format("{}: {} has several depth streams; choose one by \"stream\": {}",
                                object.where(), path.string(), all));
  }
  RecordedDepth& stream = streams[chosen];
  if (!stream.problem.empty()) {
    throw DataError(fmt::format("{}: {}: {}: {}", object.where(), path.string(), stream.stream,
                                stream.problem));
  }
  return std::move(stream);
}

/// The recorded stream, if depth is a recording; else nothing.
std::optional<RecordedDepth> ReadRecorded(const ObjectReader& object,
                                          const std::vector<std::string>& files,
                                          const std::filesystem::path& folder, ReadBudget* budget) {
  const auto is_recording = [&](const std::string& file) { return IsRecording(folder / file); };
  const auto recording = std::find_if(files.begin(), files.end(), is_recording);
  if (recording == files.end()) {
    for (const char* key : {"stream", "frames"}) {
      if (object.Has(key)) {
        throw DataError(fmt::format("{}: {} is of a recording, and depth names files; leave it out",
                                    object.where(), key));
      }
    }
    return std::nullopt;
  }
  if (files.size() > 1) {
    throw DataError(fmt::format("{}: {} is a recording; it cannot stand in a list of depth files",
                                object.where(), Shortened(*recording)));
  }
  return ReadRecordedDepth(object, folder / *recording, budget);
}

/// By the sensor itself, else stated in its recording, else for the whole capture, else usual in
/// such recordings.
double ParseDepthScale(const ObjectReader& object, const RecordedDepth& recorded,
                       std::optional<double> common) {
  std::optional<double> scale = recorded.depth_scale;
  if (common && !(scale && recorded.depth_scale_stated)) scale = common;
  if (object.Has("depth_scale")) scale = object.Number("depth_scale");
  if (!scale) {
    throw DataError(fmt::format(
        "{}: no depth_scale; give metres per unit for the capture or the sensor (0.001 for mm)",
        object.where()));
  }
  if (!(*scale > 0 && std::isfinite(*scale))) {
    throw DataError(fmt::format("{}: depth_scale = {} is no finite number of metres above 0",
                                object.where(), *scale));
  }
  return *scale;
}

/// A file's name, volalign's own keys, or one of the other forms of infer/formats.
Intrinsics ParseSensorIntrinsics(const ObjectReader& object, const std::filesystem::path& folder,
                                 const RecordedDepth& recorded, const ImageSize& size) {
  if (!object.Has("intrinsics")) {
    if (recorded.intrinsics) return *recorded.intrinsics;
    if (!recorded.intrinsics_problem.empty()) {
      throw DataError(
          fmt::format("{}: {}; give \"intrinsics\"", object.where(), recorded.intrinsics_problem));
    }
    throw DataError(
        fmt::format("{}: the key \"intrinsics\" is missing; give an object, or the name of a file",
                    object.where()));
  }
  const Json& given = object.Get("intrinsics");
  if (given.is_string()) {
    return ReadingFor(object.where(),
                      [&] { return ReadIntrinsicsFile(folder / given.get<std::string>(), size); });
  }
  if (given.is_object() && !given.contains("fx") && !given.contains("cx") && !given.empty())
    return ParseIntrinsicsText(given.dump(), object.Place("intrinsics"), size);
  if (given.is_object() && given.contains("ppx"))
    return ParseIntrinsicsText(given.dump(), object.Place("intrinsics"), size);
  return object.Read<Intrinsics>("intrinsics");
}

std::optional<ColourCamera> ParseColour(const ObjectReader& object) {
  if (!object.Has("colour")) return std::nullopt;
  const ObjectReader given = object.Child("colour");
  ColourCamera colour;
  colour.colour_from_depth = given.Read<Pose>("colour_from_depth");
  if (given.Has("intrinsics")) colour.intrinsics = given.Read<Intrinsics>("intrinsics");
  given.RejectOthers();
  return colour;
}

std::optional<PosePrior> ParsePrior(const ObjectReader& object) {
  if (!object.Has("prior")) return std::nullopt;
  const ObjectReader given = object.Child("prior");
  PosePrior prior;
  const bool in_world = given.Has("world_from_sensor");
  if (in_world == given.Has("structure_from_sensor")) {
    throw DataError(fmt::format(
        "{}: give either structure_from_sensor or world_from_sensor, a 4x4 matrix", given.where()));
  }
  const char* const key = in_world ? "world_from_sensor" : "structure_from_sensor";
  prior.world_from_sensor = given.Read<Pose>(key);
  if (in_world) prior.world = PriorWorld::kMetric;
  if (given.Has("scale")) {
    if (!in_world || given.Text("scale") != "free") {
      throw DataError(fmt::format("{}: scale may only be \"free\", and only with world_from_sensor",
                                  given.where()));
    }
    prior.world = PriorWorld::kScaleFree;
  }
  prior.sigma_m = given.Number("sigma_m");
  prior.sigma_deg = given.Number("sigma_deg");
  given.RejectOthers();
  return prior;
}

void RequireSize(const StoredDepth& image, const Intrinsics& intrinsics, const std::string& file,
                 const std::string& where) {
  if (image.values.width() == intrinsics.width && image.values.height() == intrinsics.height)
    return;
  throw DataError(
      fmt::format("{}: {} is {}x{} but the intrinsics are for {}x{}; give those of this resolution",
                  where, Shortened(file), image.values.width(), image.values.height(),
                  intrinsics.width, intrinsics.height));
}

SensorFrame ParseSensor(const ObjectReader& object, const std::filesystem::path& folder,
                        std::optional<double> common_scale, ReadBudget* budget) {
  SensorFrame frame;
  frame.name = ParseName(object);
  const std::string where = object.Renamed(fmt::format("sensor \"{}\"", frame.name));
  // This comes first, because misspelled keys are missing, too.
  object.RejectOthers({"depth", "stream", "frames", "intrinsics", "quarter_turns", "sensor",
                       "serial", "renderer", "colour", "depth_scale", "typical_intrinsics",
                       "prior"});
  frame.depth_files = ParseDepthFiles(object);
  const std::uint64_t kept = budget->kept();
  RecordedDepth source;
  std::size_t images = frame.depth_files.size();
  const auto read = [&](std::size_t i) {
    return ReadingFor(where,
                      [&] { return ReadStoredDepth(folder / frame.depth_files[i], budget); });
  };
  if (auto recorded = ReadRecorded(object, frame.depth_files, folder, budget)) {
    source = std::move(*recorded);
    images = source.frames.size();
  } else {
    source.frames.push_back(read(0));
  }
  const Image<float>& first = source.frames.front().values;
  frame.intrinsics = ParseSensorIntrinsics(object, folder, source, {first.width(), first.height()});
  if (object.Has("typical_intrinsics"))
    frame.typical_intrinsics = object.Read<bool>("typical_intrinsics");
  frame.quarter_turns = ParseTurns(object);
  frame.sensor = object.Has("sensor") ? ParsePlainText(object, "sensor") : source.kind;
  frame.serial = object.Has("serial") ? ParsePlainText(object, "serial") : source.serial;
  frame.renderer = ParsePlainText(object, "renderer");
  frame.colour = ParseColour(object);
  if (!frame.colour) frame.colour = source.colour;
  frame.prior = ParsePrior(object);
  frame.depth_scale = ParseDepthScale(object, source, common_scale);
  RequireRays(frame.intrinsics, where);
  MeanDepth mean(frame.depth_scale);
  for (std::size_t i = 0; i < images; ++i) {
    // Files are in memory one after the other.
    StoredDepth image = i < source.frames.size() ? std::move(source.frames[i]) : read(i);
    RequireSize(image, frame.intrinsics,
                frame.depth_files[std::min(i, frame.depth_files.size() - 1)], where);
    if (i < MeanDepth::kMostKept) budget->Keep(BytesOf(image), where);
    mean.Add(std::move(image));
  }
  mean.Set(&frame);
  budget->Drop(budget->kept() - kept);
  budget->Keep(sizeof(float) * (frame.depth.size() + frame.depth_sigma.size()), where);
  return frame;
}

/// Gives the sensors their poses in `truth`.
void ParseGroundTruth(const ObjectReader& truth, std::vector<SensorFrame>* sensors) {
  for (SensorFrame& frame : *sensors) truth.Optional(frame.name, frame.ground_truth);
  truth.RejectOthers();
}

std::string ReadCaptureText(const std::filesystem::path& path) {
  try {
    std::string text = ReadFile(path, kMaxTextBytes);
    if (const std::string why = WhyNoText(text); !why.empty())
      throw DataError(fmt::format("{}: {}", path.string(), why));
    return text;
  } catch (const IoError& error) {
    throw IoError(
        fmt::format("{}; give a capture.json, which docs/formats.md describes", error.what()));
  }
}

}  // namespace

std::vector<Capture> NameCaptures(std::vector<CaptureFile> files) {
  const auto name_all = [&](const auto& name_of) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < files.size(); ++i) names.push_back(name_of(i));
    return names;
  };
  const auto serve = [](const std::vector<std::string>& names) {
    return std::set<std::string>(names.begin(), names.end()).size() == names.size() &&
           std::all_of(names.begin(), names.end(), IsFileName);
  };
  std::vector<std::string> names = {""};
  if (files.size() > 1) {
    names = name_all([&](std::size_t i) { return files[i].path.stem().string(); });
    if (!serve(names)) {
      names = name_all([&](std::size_t i) {
        return std::filesystem::absolute(files[i].path).parent_path().filename().string();
      });
    }
    if (!serve(names))
      names = name_all([](std::size_t i) { return fmt::format("still_{}", i + 1); });
  }
  std::vector<Capture> captures;
  for (std::size_t i = 0; i < files.size(); ++i)
    captures.push_back({names[i], std::move(files[i].sensors)});
  return captures;
}

bool IsFileName(const std::string& name) {
  return IsPlainName(name) && !name.empty() && name[0] != '-' && name != "." && name != ".." &&
         name != "overview" && name != "merged" && name.find_first_of("/\\") == std::string::npos;
}

CaptureFile ReadCapture(const std::filesystem::path& path) {
  const std::string name = path.string();
  const Json document = ParseStrictJson(ReadCaptureText(path), name);
  const ObjectReader root(document, name);
  root.RejectOthers({"format", "depth_scale", "structure", "sensors", "ground_truth"});

  if (root.Has("format") && root.Text("format") != kCaptureFormat) {
    throw DataError(fmt::format("{}: format \"{}\" is unknown; this version reads \"{}\"", name,
                                Shortened(root.Text("format")), kCaptureFormat));
  }
  CaptureFile capture;
  capture.path = path;
  const std::filesystem::path folder = path.parent_path();
  std::optional<double> scale;
  if (root.Has("depth_scale")) scale = root.Number("depth_scale");
  if (root.Has("structure")) capture.structure = folder / root.Text("structure");

  std::set<std::string> names;
  ReadBudget budget;
  const std::vector<ObjectReader> sensors = root.Children("sensors");
  if (sensors.size() > kMostSensors) {
    throw DataError(fmt::format("{}: {} sensors; at most {} are calibrated together", name,
                                sensors.size(), kMostSensors));
  }
  for (const ObjectReader& object : sensors) {
    capture.sensors.push_back(ParseSensor(object, folder, scale, &budget));
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
    ParseGroundTruth(root.Child("ground_truth"), &capture.sensors);
  }
  return capture;
}

}  // namespace volalign
