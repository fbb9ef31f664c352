#include "infer/io/extrinsics.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_util.h"
#include "core/strict_json.h"

namespace volalign {

namespace {

using Json = nlohmann::ordered_json;

constexpr char kConvention[] =
    "structure_from_sensor, metres, row-major, sensor: x right y down z forward, structure: y up";

double Finite(double value, const std::string& what) {
  if (!std::isfinite(value))
    throw Error(fmt::format("{} = {} is not finite and was not written", what, value));
  return value;
}

Json Vector(const Eigen::Vector3d& v, const std::string& what) {
  return {Finite(v.x(), what), Finite(v.y(), what), Finite(v.z(), what)};
}

Json ErrorJson(const PoseError& error) {
  return {{"translation_m", Finite(error.translation_m, "translation_m")},
          {"rotation_deg", Finite(error.rotation_deg, "rotation_deg")}};
}

void PutText(Json* object, const char* key, const std::string& text) {
  if (!text.empty()) (*object)[key] = text;
}

Json SensorJson(const Extrinsics::Sensor& sensor) {
  Json json = {{"status", sensor.status}};
  PutText(&json, "code", sensor.code);
  PutText(&json, "reason", sensor.reason);
  PutText(&json, "hint", sensor.hint);
  if (sensor.structure_from_sensor) {
    json["structure_from_sensor"] = ToRows(*sensor.structure_from_sensor);
    if (sensor.initial) json["initial"] = ToRows(*sensor.initial);
    json["refinement"] = sensor.refinement;
    json["sides"] = sensor.sides;
    json["points"] = sensor.points;
    const auto put = [&](const char* key, double value) {
      json[key] = Finite(value, sensor.name + ": " + key);
    };
    put("rms_to_structure_m", sensor.rms_to_structure_m);
    put("initial_rms_to_structure_m", sensor.initial_rms_to_structure_m);
    put("inlier_share", sensor.inlier_share);
    put("miou", sensor.miou);
    put("label_iou", sensor.label_iou);
    put("explained_share", sensor.explained_share);
    put("depth_offset_m", sensor.depth_offset_m);
    put("depth_gain", sensor.depth_gain);
    put("sigma_depth_offset_m", sensor.sigma_depth_offset_m);
    put("sigma_depth_gain", sensor.sigma_depth_gain);
    if (!sensor.unconstrained.empty()) json["unconstrained"] = sensor.unconstrained;
    Json covariance = Json::array();
    for (int i = 0; i < 6; ++i) {
      Json row = Json::array();
      for (int j = 0; j < 6; ++j)
        row.push_back(Finite(sensor.covariance(i, j), sensor.name + ": covariance"));
      covariance.push_back(row);
    }
    json["covariance"] = covariance;
    json["sigma_translation_m"] =
        Vector(sensor.sigma_translation_m, sensor.name + ": sigma_translation_m");
    json["sigma_rotation_deg"] =
        Vector(sensor.sigma_rotation_deg, sensor.name + ": sigma_rotation_deg");
    if (sensor.error) json["error"] = ErrorJson(*sensor.error);
    if (sensor.initial_error) json["initial_error"] = ErrorJson(*sensor.initial_error);
  }
  const Intrinsics& k = sensor.intrinsics;
  json["intrinsics"] = {
      {"width", k.width}, {"height", k.height},        {"fx", k.fx}, {"fy", k.fy}, {"cx", k.cx},
      {"cy", k.cy},       {"distortion", k.distortion}};
  if (sensor.depth.size() == 1) json["depth"] = sensor.depth.front();
  if (sensor.depth.size() > 1) json["depth"] = sensor.depth;
  json["depth_scale"] = Finite(sensor.depth_scale, "depth_scale");
  json["quarter_turns"] = sensor.quarter_turns;
  PutText(&json, "serial", sensor.serial);
  return json;
}

Json AssemblyJson(const Extrinsics::Assembly& assembly) {
  Json json = Json::object();
  PutText(&json, "code", assembly.code);
  json["sentence"] = assembly.sentence;
  PutText(&json, "box", assembly.box);
  PutText(&json, "other_box", assembly.other_box);
  if (assembly.turn_deg != 0) json["turn_deg"] = assembly.turn_deg;
  json["overlap"] = Finite(assembly.overlap, "assembly: overlap");
  json["described_overlap"] = Finite(assembly.described_overlap, "assembly: described_overlap");
  return json;
}

Extrinsics::Assembly ParseAssembly(const JsonObject& object) {
  Extrinsics::Assembly assembly;
  const auto text = [&](const char* key) {
    return object.Has(key) ? object.Text(key) : std::string();
  };
  assembly.code = text("code");
  assembly.sentence = object.Text("sentence");
  assembly.box = text("box");
  assembly.other_box = text("other_box");
  if (object.Has("turn_deg")) assembly.turn_deg = object.Int("turn_deg");
  assembly.overlap = object.Number("overlap");
  assembly.described_overlap = object.Number("described_overlap");
  object.RejectOthers();
  return assembly;
}

PoseError ParseError(const JsonObject& object) {
  PoseError error{object.Number("translation_m"), object.Number("rotation_deg")};
  object.RejectOthers();
  return error;
}

Eigen::Vector3d ParseVector(const JsonObject& object, const std::string& key) {
  const std::vector<double> values = object.Numbers(key);
  if (values.size() != 3) {
    throw DataError(
        fmt::format("{}: {} has {} numbers, not 3", object.where(), key, values.size()));
  }
  return {values[0], values[1], values[2]};
}

Extrinsics::Sensor ParseSensor(const std::string& name, const JsonObject& object) {
  Extrinsics::Sensor sensor;
  sensor.name = name;
  const auto text = [&](const char* key) {
    return object.Has(key) ? object.Text(key) : std::string();
  };
  sensor.status = object.Text("status");
  if (sensor.status != "ok" && sensor.status != "weak" && sensor.status != "failed") {
    throw DataError(fmt::format("{}: status \"{}\" is none of ok, weak, failed", object.where(),
                                sensor.status));
  }
  sensor.code = text("code");
  sensor.reason = text("reason");
  sensor.hint = text("hint");
  if ((sensor.status == "failed") == object.Has("structure_from_sensor")) {
    throw DataError(fmt::format(
        "{}: status \"{}\" and the {} of structure_from_sensor contradict each other",
        object.where(), sensor.status, sensor.status == "failed" ? "presence" : "absence"));
  }
  if (object.Has("structure_from_sensor")) {
    const auto pose = [&](const char* key) {
      return PoseFromRows(object.Matrix(key), object.where() + ": " + key);
    };
    sensor.structure_from_sensor = pose("structure_from_sensor");
    if (object.Has("initial")) sensor.initial = pose("initial");
    sensor.refinement = object.Text("refinement");
    sensor.sides = object.Texts("sides");
    sensor.points = object.Int("points");
    sensor.rms_to_structure_m = object.Number("rms_to_structure_m");
    sensor.initial_rms_to_structure_m = object.Number("initial_rms_to_structure_m");
    sensor.inlier_share = object.Number("inlier_share");
    sensor.miou = object.Number("miou");
    sensor.label_iou = object.Number("label_iou");
    sensor.explained_share = object.Number("explained_share");
    sensor.depth_offset_m = object.Number("depth_offset_m");
    if (object.Has("depth_gain")) {  // the first files had none of these
      sensor.depth_gain = object.Number("depth_gain");
      sensor.sigma_depth_offset_m = object.Number("sigma_depth_offset_m");
      sensor.sigma_depth_gain = object.Number("sigma_depth_gain");
    }
    if (object.Has("unconstrained")) sensor.unconstrained = object.Texts("unconstrained");
    const std::vector<std::vector<double>> rows = object.Matrix("covariance");
    bool square = rows.size() == 6;
    for (const auto& row : rows) square = square && row.size() == 6;
    if (!square) throw DataError(object.where() + ": covariance is not 6x6");
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        sensor.covariance(i, j) = rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
      }
    }
    sensor.sigma_translation_m = ParseVector(object, "sigma_translation_m");
    sensor.sigma_rotation_deg = ParseVector(object, "sigma_rotation_deg");
    if (object.Has("error")) sensor.error = ParseError(object.Child("error"));
    if (object.Has("initial_error"))
      sensor.initial_error = ParseError(object.Child("initial_error"));
  }
  sensor.intrinsics = ParseIntrinsics(object.Child("intrinsics"));
  if (object.Has("depth")) {
    sensor.depth = object.Get("depth").is_string() ? std::vector<std::string>{object.Text("depth")}
                                                   : object.Texts("depth");
  }
  sensor.depth_scale = object.Number("depth_scale");
  sensor.quarter_turns = object.Int("quarter_turns");
  sensor.serial = text("serial");
  object.RejectOthers();
  return sensor;
}

}  // namespace

Extrinsics MakeExtrinsics(const CalibrationResult& result, const std::vector<SensorFrame>& frames,
                          const Structure& structure, const ExtrinsicsSource& source) {
  Extrinsics out;
  out.tool = "volalign " VOLALIGN_VERSION;
  out.capture = source.capture;
  out.structure_name = structure.name();
  out.structure_sha256 = structure.Hash();
  out.model_file = source.model_file;
  out.model_sha256 = source.model_sha256;
  out.verdict = ToString(result.verdict());
  if (result.assembly) {
    const Arrangement& found = result.assembly->arrangement;
    out.assembly = Extrinsics::Assembly{ToString(found.code),
                                        found.sentence,
                                        found.box,
                                        found.other_box,
                                        found.turn_deg,
                                        result.assembly->overlap,
                                        result.assembly->described_overlap};
  }
  for (std::size_t i = 0; i < result.sensors.size(); ++i) {
    const SensorResult& from = result.sensors[i];
    const SensorFrame& frame = frames.at(i);
    Extrinsics::Sensor sensor;
    sensor.name = from.name;
    sensor.status = ToString(from.status);
    sensor.code = ToString(from.code);
    sensor.reason = from.reason;
    sensor.hint = from.hint;
    if (from.structure_from_sensor) {
      sensor.structure_from_sensor = from.structure_from_sensor;
      sensor.initial = from.initial;
      sensor.refinement = from.refinement_accepted ? "accepted" : "kept_initial";
      sensor.sides = from.sides;
      sensor.points = from.points;
      sensor.rms_to_structure_m = from.rms_to_structure_m;
      sensor.initial_rms_to_structure_m = from.initial_rms_to_structure_m;
      sensor.inlier_share = from.inlier_share;
      sensor.miou = from.miou;
      sensor.label_iou = from.label_iou;
      sensor.explained_share = from.explained_share;
      sensor.depth_offset_m = from.depth_offset_m;
      sensor.depth_gain = from.depth_gain;
      sensor.sigma_depth_offset_m = from.sigma_depth_offset_m;
      sensor.sigma_depth_gain = from.sigma_depth_gain;
      sensor.unconstrained = UnconstrainedDirections(from.covariance);
      sensor.covariance = from.covariance;
      sensor.sigma_translation_m = from.sigma_translation_m();
      sensor.sigma_rotation_deg = from.sigma_rotation_deg();
      sensor.error = from.error;
      sensor.initial_error = from.initial_error;
    }
    sensor.intrinsics = frame.intrinsics;
    sensor.depth = frame.depth_files;
    sensor.depth_scale = frame.depth_scale;
    sensor.quarter_turns = from.quarter_turns;
    sensor.serial = frame.serial;
    out.sensors.push_back(std::move(sensor));
  }
  for (std::size_t b = 0; b < result.boxes.size(); ++b) {
    const RefinedBox& from = result.boxes[b];
    Extrinsics::Box box;
    box.name = structure.boxes().at(b).name;
    box.estimated = from.estimated;
    box.translation_m = result.built.boxes().at(b).structure_from_box.translation() -
                        structure.boxes().at(b).structure_from_box.translation();
    box.yaw_deg = from.yaw * 180 / M_PI;
    box.sigma_x_m = from.sigma_x;
    box.sigma_z_m = from.sigma_z;
    box.sigma_yaw_deg = from.sigma_yaw * 180 / M_PI;
    out.boxes.push_back(box);
  }
  out.size_estimated = result.size_estimated;
  out.size_scale = result.size_scale;
  out.sigma_size_scale = result.sigma_size_scale;
  out.pairs = result.pairs;
  out.metrics = result.metrics;
  out.timings_s = result.timings_s;
  return out;
}

void WriteExtrinsics(const std::filesystem::path& path, const Extrinsics& extrinsics) {
  Json json = {
      {"format", kExtrinsicsFormat}, {"tool", extrinsics.tool}, {"convention", kConvention}};
  PutText(&json, "capture", extrinsics.capture);
  json["structure"] = {{"name", extrinsics.structure_name},
                       {"sha256", extrinsics.structure_sha256}};
  if (!extrinsics.model_file.empty()) {
    json["model"] = {{"file", extrinsics.model_file}, {"sha256", extrinsics.model_sha256}};
  }
  json["verdict"] = extrinsics.verdict;
  if (extrinsics.assembly) json["assembly"] = AssemblyJson(*extrinsics.assembly);
  json["sensors"] = Json::object();
  for (const Extrinsics::Sensor& sensor : extrinsics.sensors)
    json["sensors"][sensor.name] = SensorJson(sensor);
  json["boxes"] = Json::array();
  for (const Extrinsics::Box& box : extrinsics.boxes) {
    json["boxes"].push_back({{"name", box.name},
                             {"estimated", box.estimated},
                             {"translation_m", Vector(box.translation_m, box.name)},
                             {"yaw_deg", Finite(box.yaw_deg, box.name)},
                             {"sigma_x_m", Finite(box.sigma_x_m, box.name)},
                             {"sigma_z_m", Finite(box.sigma_z_m, box.name)},
                             {"sigma_yaw_deg", Finite(box.sigma_yaw_deg, box.name)}});
  }
  json["size"] = {{"estimated", extrinsics.size_estimated},
                  {"scale", Finite(extrinsics.size_scale, "size scale")},
                  {"sigma", Finite(extrinsics.sigma_size_scale, "size sigma")}};
  json["pairs"] = Json::array();
  for (const PairResult& pair : extrinsics.pairs) {
    json["pairs"].push_back({{"a", pair.a},
                             {"b", pair.b},
                             {"overlap", Finite(pair.overlap, "overlap")},
                             {"rms_m", Finite(pair.rms_m, "rms_m")}});
  }
  if (extrinsics.metrics) {
    json["metrics"] = {{"d1_m", Finite(extrinsics.metrics->d1, "d1_m")},
                       {"d2_m", Finite(extrinsics.metrics->d2, "d2_m")}};
  }
  json["timings_s"] = Json::object();
  for (const auto& [stage, seconds] : extrinsics.timings_s)
    json["timings_s"][stage] = Finite(seconds, stage);
  WriteFileAtomically(path, json.dump(2) + "\n");
}

Extrinsics ReadExtrinsics(const std::filesystem::path& path) {
  const std::string name = path.string();
  const nlohmann::json document = ParseStrictJson(ReadFile(path), name);
  const JsonObject root(document, name);
  if (root.Text("format") != kExtrinsicsFormat) {
    throw DataError(fmt::format("{}: format \"{}\" is unknown; this version reads \"{}\"", name,
                                root.Text("format"), kExtrinsicsFormat));
  }
  Extrinsics extrinsics;
  extrinsics.tool = root.Text("tool");
  if (root.Text("convention") != kConvention) {
    throw DataError(fmt::format("{}: convention \"{}\" is not \"{}\"", name,
                                root.Text("convention"), kConvention));
  }
  if (root.Has("capture")) extrinsics.capture = root.Text("capture");
  const JsonObject structure = root.Child("structure");
  extrinsics.structure_name = structure.Text("name");
  extrinsics.structure_sha256 = structure.Text("sha256");
  structure.RejectOthers();
  if (root.Has("model")) {
    const JsonObject model = root.Child("model");
    extrinsics.model_file = model.Text("file");
    extrinsics.model_sha256 = model.Text("sha256");
    model.RejectOthers();
  }
  extrinsics.verdict = root.Text("verdict");
  if (root.Has("assembly")) extrinsics.assembly = ParseAssembly(root.Child("assembly"));
  const JsonObject sensors = root.Child("sensors");
  for (const std::string& sensor : sensors.Keys()) {
    extrinsics.sensors.push_back(ParseSensor(sensor, sensors.Child(sensor)));
  }
  const auto boxes = root.Has("boxes") ? root.Children("boxes") : std::vector<JsonObject>();
  for (const JsonObject& from : boxes) {
    Extrinsics::Box box;
    box.name = from.Text("name");
    box.estimated = from.Bool("estimated");
    box.translation_m = ParseVector(from, "translation_m");
    box.yaw_deg = from.Number("yaw_deg");
    box.sigma_x_m = from.Number("sigma_x_m");
    box.sigma_z_m = from.Number("sigma_z_m");
    box.sigma_yaw_deg = from.Number("sigma_yaw_deg");
    from.RejectOthers();
    extrinsics.boxes.push_back(box);
  }
  if (root.Has("size")) {
    const JsonObject size = root.Child("size");
    extrinsics.size_estimated = size.Bool("estimated");
    extrinsics.size_scale = size.Number("scale");
    extrinsics.sigma_size_scale = size.Number("sigma");
    size.RejectOthers();
  }
  for (const JsonObject& pair : root.Children("pairs")) {
    extrinsics.pairs.push_back(
        {pair.Text("a"), pair.Text("b"), pair.Number("overlap"), pair.Number("rms_m")});
    pair.RejectOthers();
  }
  if (root.Has("metrics")) {
    const JsonObject metrics = root.Child("metrics");
    extrinsics.metrics = SetDistances{metrics.Number("d1_m"), metrics.Number("d2_m")};
    metrics.RejectOthers();
  }
  const JsonObject timings = root.Child("timings_s");
  for (const std::string& stage : timings.Keys()) {
    extrinsics.timings_s.emplace_back(stage, timings.Number(stage));
  }
  root.RejectOthers();
  return extrinsics;
}

}  // namespace volalign
