#include "infer/io/extrinsics.h"

#include <fmt/format.h>

#include <cmath>

#include "core/error.h"
#include "core/file_util.h"
#include "core/json_archive.h"
#include "infer/refine/refine.h"

namespace volalign {

namespace {

constexpr char kConvention[] =
    "structure_from_sensor, metres, row-major, sensor: x right y down z forward, structure: y up";

}  // namespace

// The file's keys.

template <class Archive>
void Describe(Archive& ar, SensorOutcome& sensor) {
  ar("status", sensor.status);
  ar.Optional("code", sensor.code);
  ar.Optional("reason", sensor.reason);
  ar.Optional("hint", sensor.hint);
  ar.Optional("structure_from_sensor", sensor.structure_from_sensor);
  const bool failed = sensor.status == SensorStatus::kFailed;
  if (Archive::kReading && failed == sensor.structure_from_sensor.has_value()) {
    throw DataError(
        fmt::format("{}: status \"{}\" and the {} of structure_from_sensor contradict each other",
                    ar.where(), ToString(sensor.status), failed ? "presence" : "absence"));
  }
  if (!sensor.structure_from_sensor) return;
  ar.Later("initial", sensor.initial);
  ar.Choice("refinement", sensor.refinement_accepted, "accepted", "kept_initial");
  ar("sides", sensor.sides);
  ar("points", sensor.points);
  ar("rms_to_structure_m", sensor.rms_to_structure_m);
  ar("initial_rms_to_structure_m", sensor.initial_rms_to_structure_m);
  ar("inlier_share", sensor.inlier_share);
  ar("miou", sensor.miou);
  ar("label_iou", sensor.label_iou);
  ar("explained_share", sensor.explained_share);
  ar("depth_offset_m", sensor.depth_offset_m);
  ar.Later("depth_gain", sensor.depth_gain);
  ar.Later("sigma_depth_offset_m", sensor.sigma_depth_offset_m);
  ar.Later("sigma_depth_gain", sensor.sigma_depth_gain);
  // What follows from the covariance is read and dropped.
  std::vector<std::string> unconstrained;
  if (!Archive::kReading) unconstrained = UnconstrainedDirections(sensor.covariance);
  ar.Optional("unconstrained", unconstrained);
  ar("covariance", sensor.covariance);
  Eigen::Vector3d sigma_translation_m = sensor.sigma_translation_m();
  Eigen::Vector3d sigma_rotation_deg = sensor.sigma_rotation_deg();
  ar("sigma_translation_m", sigma_translation_m);
  ar("sigma_rotation_deg", sigma_rotation_deg);
  ar.Optional("error", sensor.error);
  ar.Optional("initial_error", sensor.initial_error);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Sensor& sensor) {
  Describe(ar, static_cast<SensorOutcome&>(sensor));
  ar("intrinsics", sensor.intrinsics);
  ar.OneOrList("depth", sensor.depth_files);
  ar("depth_scale", sensor.depth_scale);
  ar("quarter_turns", sensor.quarter_turns);
  ar.Optional("serial", sensor.serial);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Box& box) {
  ar("name", box.name);
  ar("estimated", box.estimated);
  ar("translation_m", box.translation_m);
  ar("yaw_deg", box.yaw_deg);
  ar("sigma_x_m", box.sigma_x_m);
  ar("sigma_z_m", box.sigma_z_m);
  ar("sigma_yaw_deg", box.sigma_yaw_deg);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Size& size) {
  ar("estimated", size.estimated);
  ar("scale", size.scale);
  ar("sigma", size.sigma);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::StructureId& structure) {
  ar("name", structure.name);
  ar("sha256", structure.sha256);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics::Model& model) {
  ar("file", model.file);
  ar("sha256", model.sha256);
}

template <class Archive>
void Describe(Archive& ar, AssemblyReport& assembly) {
  Arrangement& found = assembly.arrangement;
  ar.Optional("code", found.code);
  ar("sentence", found.sentence);
  ar.Optional("box", found.box);
  ar.Optional("other_box", found.other_box);
  ar.Optional("turn_deg", found.turn_deg);
  ar("overlap", assembly.overlap);
  ar("described_overlap", assembly.described_overlap);
}

template <class Archive>
void Describe(Archive& ar, PairResult& pair) {
  ar("a", pair.a);
  ar("b", pair.b);
  ar("overlap", pair.overlap);
  ar("rms_m", pair.rms_m);
}

template <class Archive>
void Describe(Archive& ar, SetDistances& distances) {
  ar("d1_m", distances.d1);
  ar("d2_m", distances.d2);
}

template <class Archive>
void Describe(Archive& ar, Extrinsics& extrinsics) {
  ar.Constant("format", kExtrinsicsFormat);
  ar("tool", extrinsics.tool);
  ar.Constant("convention", kConvention);
  ar.Optional("capture", extrinsics.capture);
  ar("structure", extrinsics.structure);
  ar.Optional("model", extrinsics.model);
  ar("verdict", extrinsics.verdict);
  ar.Optional("assembly", extrinsics.assembly);
  ar.ByName("sensors", extrinsics.sensors, &Extrinsics::Sensor::name);
  ar.Later("boxes", extrinsics.boxes);
  ar.Later("size", extrinsics.size);
  ar("pairs", extrinsics.pairs);
  ar.Optional("metrics", extrinsics.metrics);
  ar("timings_s", extrinsics.timings_s);
}

namespace {

Extrinsics::Sensor SensorOf(const SensorResult& result, const SensorFrame& frame) {
  Extrinsics::Sensor sensor;
  static_cast<SensorOutcome&>(sensor) = result;
  sensor.intrinsics = frame.intrinsics;
  sensor.depth_files = frame.depth_files;
  sensor.depth_scale = frame.depth_scale;
  sensor.serial = frame.serial;
  return sensor;
}

Extrinsics::Box BoxOf(const RefinedBox& found, const Box& nominal, const Box& built) {
  Extrinsics::Box box;
  box.name = nominal.name;
  box.estimated = found.estimated;
  box.translation_m =
      built.structure_from_box.translation() - nominal.structure_from_box.translation();
  box.yaw_deg = found.yaw * 180 / M_PI;
  box.sigma_x_m = found.sigma_x;
  box.sigma_z_m = found.sigma_z;
  box.sigma_yaw_deg = found.sigma_yaw * 180 / M_PI;
  return box;
}

}  // namespace

Extrinsics MakeExtrinsics(const CalibrationResult& result, const std::vector<SensorFrame>& frames,
                          const Structure& structure, const ExtrinsicsSource& source) {
  Extrinsics out;
  out.tool = "volalign " VOLALIGN_VERSION;
  out.capture = source.capture;
  out.structure = {structure.name(), structure.Hash()};
  if (!source.model_file.empty())
    out.model = Extrinsics::Model{source.model_file, source.model_sha256};
  out.verdict = result.verdict();
  out.assembly = result.assembly;
  for (std::size_t i = 0; i < result.sensors.size(); ++i) {
    out.sensors.push_back(SensorOf(result.sensors[i], frames.at(i)));
  }
  for (std::size_t b = 0; b < result.boxes.size(); ++b) {
    out.boxes.push_back(
        BoxOf(result.boxes[b], structure.boxes().at(b), result.built.boxes().at(b)));
  }
  out.size = {result.size_estimated, result.size_scale, result.sigma_size_scale};
  out.pairs = result.pairs;
  out.metrics = result.metrics;
  out.timings_s = result.timings_s;
  return out;
}

void WriteExtrinsics(const std::filesystem::path& path, const Extrinsics& extrinsics) {
  WriteFileAtomically(path, WriteDescribed(extrinsics, path.string(), 2));
}

Extrinsics ReadExtrinsics(const std::filesystem::path& path) {
  return ReadDescribed<Extrinsics>(ReadFile(path), path.string());
}

}  // namespace volalign
