#include "infer/report/extrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/provenance.h"
#include "core/base/text.h"
#include "core/json/json_archive.h"
#include "infer/calib/describe_result.h"
#include "infer/refine/refine.h"

namespace volalign {

namespace {

constexpr char kConvention[] =
    "structure_from_sensor, metres, row-major, sensor: x right y down z forward, structure: y up";

}  // namespace

// The file's keys.

template <class Archive>
void Describe(Archive& ar, Extrinsics::Colour& colour) {
  ar.Optional("structure_from_colour", colour.structure_from_colour);
  ar("colour_from_depth", colour.colour_from_depth);
  ar.Optional("intrinsics", colour.intrinsics);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Sensor& sensor) {
  Describe(ar, static_cast<SensorOutcome&>(sensor));
  ar("intrinsics", sensor.intrinsics);
  // The first files have the given intrinsics alone.
  ar.OptionalSinceVersion("intrinsics_given", sensor.intrinsics_given);
  ar.OptionalSinceVersion("lens", sensor.lens);
  ar.Optional("sensor", sensor.sensor);
  ar.OneOrList("depth", sensor.depth_files);
  ar("depth_scale", sensor.depth_scale);
  ar("quarter_turns", sensor.quarter_turns);
  ar.Optional("serial", sensor.serial);
  ar.Optional("renderer", sensor.renderer);
  ar.Optional("colour", sensor.colour);
  ar.Optional("world_from_sensor", sensor.world_from_sensor);
  ar.IfFinite("world_covariance", sensor.world_covariance);
}

template <class Archive>
void Describe(Archive& ar, WorldFrame& world) {
  ar("name", world.name);
  ar("world_from_structure", world.world_from_structure);
  ar("covariance", world.covariance);
  ar.Optional("rms_m", world.rms_m);
  ar.Optional("carrier_from_structure", world.carrier_from_structure);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Box& box) {
  ar("name", box.name);
  ar("estimated", box.estimated);
  ar.IfFinite("translation_m", box.translation_m);
  ar.IfFinite("yaw_deg", box.yaw_deg);
  ar.IfFinite("sigma_x_m", box.sigma_x_m);
  ar.IfFinite("sigma_z_m", box.sigma_z_m);
  ar.IfFinite("sigma_yaw_deg", box.sigma_yaw_deg);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Size& size) {
  ar("estimated", size.estimated);
  ar.IfFinite("scale", size.scale);
  ar.IfFinite("sigma", size.sigma);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Placement& placement) {
  ar.Optional("name", placement.name);
  ar.Optional("capture", placement.capture);
  ar("first_from_placement", placement.first_from_placement);
  ar.IfFinite("sigma_translation_m", placement.sigma_translation_m);
  ar.IfFinite("sigma_rotation_deg", placement.sigma_rotation_deg);
  ar.IfFinite("covariance", placement.covariance);
  ar("sensors", placement.sensors);
  ar("boxes", placement.boxes);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::StructureId& structure) {
  ar("name", structure.name);
  ar("sha256", structure.sha256);
  ar.Optional("floor_m", structure.floor_m);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Model& model) {
  ar("file", model.file);
  ar("sha256", model.sha256);
  ar.Optional("runtime", model.runtime);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics& extrinsics) {
  ar.Constant("format", kExtrinsicsFormat);
  ar("tool", extrinsics.tool);
  ar.Optional("date", extrinsics.date);
  ar.Optional("libraries", extrinsics.libraries);
  ar.Optional("note", extrinsics.note);
  ar.Constant("convention", kConvention);
  ar.OneOrList("capture", extrinsics.captures);
  ar("structure", extrinsics.structure);
  ar.Optional("model", extrinsics.model);
  ar.Optional("world", extrinsics.world);
  ar("verdict", extrinsics.verdict);
  ar.Optional("findings", extrinsics.findings);
  ar.Optional("assembly", extrinsics.assembly);
  ar.ByName("sensors", extrinsics.sensors, &Extrinsics::Sensor::name);
  ar.OptionalSinceVersion("boxes", extrinsics.boxes);
  ar.OptionalSinceVersion("size", extrinsics.size);
  ar.OptionalSinceVersion("placements", extrinsics.placements);
  ar.OptionalSinceVersion("solution", extrinsics.solution);
  ar("pairs", extrinsics.pairs);
  ar.Optional("twins", extrinsics.alternatives);
  ar.Optional("metrics", extrinsics.metrics);
  ar("timings_s", extrinsics.timings_s);
}

namespace {

std::string Libraries() {
  return fmt::format("Ceres {}, Eigen {}.{}.{}", CeresVersion(), EIGEN_WORLD_VERSION,
                     EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION);
}

Extrinsics::Sensor SensorOf(const FrameResult& result, const SensorFrame& frame) {
  Extrinsics::Sensor sensor;
  static_cast<SensorOutcome&>(sensor) = result;
  sensor.sensor = frame.sensor;
  sensor.depth_files = frame.depth_files;
  sensor.depth_scale = frame.depth_scale;
  sensor.serial = frame.serial;
  sensor.renderer = frame.renderer;
  DemoteIfNotFinite(&sensor);
  if (frame.colour) {
    sensor.colour = Extrinsics::Colour{*frame.colour, std::nullopt};
    if (sensor.structure_from_sensor) {
      sensor.colour->structure_from_colour =
          *sensor.structure_from_sensor * frame.colour->colour_from_depth.inverse();
    }
  }
  return sensor;
}

std::vector<Extrinsics::Box> BoxesOf(const std::vector<RefinedBox>& found, const Structure& nominal,
                                     const Structure& built) {
  std::vector<Extrinsics::Box> boxes;
  for (std::size_t b = 0; b < found.size(); ++b) {
    const Box& box = nominal.boxes().at(b);
    boxes.push_back({box.name, found[b].estimated,
                     built.boxes().at(b).structure_from_box.translation() -
                         box.structure_from_box.translation(),
                     found[b].yaw / kDegree, found[b].sigma_x, found[b].sigma_z,
                     found[b].sigma_yaw / kDegree});
  }
  return boxes;
}

/// Names of the sensors with a pose.
std::vector<std::string> Placed(const std::vector<FrameResult>& sensors) {
  std::vector<std::string> names;
  for (const FrameResult& sensor : sensors) {
    if (sensor.structure_from_sensor) names.push_back(sensor.name);
  }
  return names;
}

std::vector<Extrinsics::Placement> PlacementsOf(const CalibrationResult& result,
                                                const Structure& structure,
                                                const std::vector<std::string>& captures) {
  const auto file_of = [&](std::size_t s) { return s < captures.size() ? captures[s] : ""; };
  std::vector<Extrinsics::Placement> placements;
  if (result.captures.empty()) {
    Extrinsics::Placement only;
    only.capture = file_of(0);
    only.sensors = Placed(result.sensors);
    only.boxes = BoxesOf(result.boxes, structure, result.built);
    return {only};
  }
  for (std::size_t s = 0; s < result.captures.size(); ++s) {
    const CaptureResult& capture = result.captures[s];
    placements.push_back({capture.name, file_of(s), capture.first_from_placement,
                          SigmaTranslation(capture.covariance),
                          SigmaRotationDeg(capture.covariance), Placed(capture.sensors),
                          BoxesOf(capture.boxes, structure, capture.built), capture.covariance});
  }
  return placements;
}

/// The first frame of a sensor.
const SensorFrame& FrameOfSensor(const std::vector<Capture>& captures, const std::string& name) {
  for (const Capture& capture : captures) {
    for (const SensorFrame& frame : capture.frames) {
      if (frame.name == name) return frame;
    }
  }
  throw Error(fmt::format("sensor \"{}\" is in no capture of its result", name));
}

}  // namespace

Extrinsics MakeExtrinsics(const CalibrationResult& result, const std::vector<Capture>& captures,
                          const Structure& structure, const ExtrinsicsSource& source) {
  Extrinsics out;
  out.tool = Tool();
  out.date = source.date;
  out.note = source.note;
  out.libraries = Libraries();
  out.captures = source.captures;
  out.structure = {structure.name(), structure.Hash(), structure.FloorHeight()};
  if (!source.model_file.empty())
    out.model = Extrinsics::Model{source.model_file, source.model_sha256, source.model_runtime};
  out.world = source.world;
  out.findings = result.findings;
  out.assembly = result.assembly;
  out.verdict = result.verdict();
  for (const FrameResult& sensor : result.sensors) {
    out.sensors.push_back(SensorOf(sensor, FrameOfSensor(captures, sensor.name)));
    out.verdict = std::max(out.verdict, out.sensors.back().status);
  }
  out.boxes = BoxesOf(result.boxes, structure, result.built);
  out.placements = PlacementsOf(result, structure, source.captures);
  out.size = {result.size_estimated, result.size_scale, result.sigma_size_scale};
  out.pairs = result.pairs;
  out.alternatives = result.alternatives;
  out.metrics = result.metrics;
  out.solution = result.solve;
  out.timings_s = result.timings_s;
  return out;
}

namespace {

/// With each sensor's pose in the world.
Extrinsics WithWorldPoses(Extrinsics extrinsics) {
  if (!extrinsics.world) return extrinsics;
  for (Extrinsics::Sensor& sensor : extrinsics.sensors) {
    if (!sensor.structure_from_sensor) continue;
    sensor.world_from_sensor =
        extrinsics.world->world_from_structure * *sensor.structure_from_sensor;
    sensor.world_covariance = CovarianceInWorld(*extrinsics.world, sensor.covariance);
  }
  return extrinsics;
}

}  // namespace

nlohmann::ordered_json ExtrinsicsJson(const Extrinsics& extrinsics, const std::string& where) {
  return DescribedJson(WithWorldPoses(extrinsics), where);
}

namespace {

void RequirePlainNames(const Extrinsics& extrinsics, const std::filesystem::path& path) {
  for (const Extrinsics::Sensor& sensor : extrinsics.sensors)
    RequirePlainName(sensor.name, path.string());
  if (extrinsics.world) RequirePlainName(extrinsics.world->name, path.string());
}

}  // namespace

void WriteExtrinsics(const std::filesystem::path& path, const Extrinsics& extrinsics) {
  RequirePlainNames(extrinsics, path);
  WriteFileAtomically(path, WriteDescribed(WithWorldPoses(extrinsics), path.string(), 2));
}

Extrinsics ReadExtrinsics(const std::filesystem::path& file_or_folder) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::is_directory(file_or_folder, error)
                                         ? file_or_folder / kExtrinsicsFile
                                         : file_or_folder;
  auto extrinsics = ReadDescribed<Extrinsics>(ReadFile(path, kMaxResultBytes), path.string());
  RequirePlainNames(extrinsics, path);
  return extrinsics;
}

}  // namespace volalign
