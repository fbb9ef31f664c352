// Formats that are JSON: ours, Open3D's camera trajectory, and one for Unity's JsonUtility.

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/json/json_archive.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::poses_internal {

namespace {

using nlohmann::ordered_json;

constexpr int kCwipcVersion = 3;
constexpr char kPosesFormat[] = "volalign.poses/1";
constexpr char kPosesConvention[] =
    "structure_from_sensor: p_structure = T p_sensor, 4x4, row-major, metres. Sensor: x right, y "
    "down, z forward. Structure: {}. Pixel centres at integer coordinates";
constexpr char kOpen3dConvention[] =
    "extrinsic: camera_from_world, 4x4, column-major, metres. Camera: x right, y down, z forward. "
    "World: {}. intrinsic_matrix: 3x3, column-major, pixel centres at integer coordinates";
constexpr char kUnityConvention[] =
    "position and rotation of transforms in a left-handed world, y up, metres. (x, y, z) of "
    "volalign's ({}) is (-x, y, z). The transform's +z looks at the scene, its +y is the top of "
    "the picture. rotation: quaternion x, y, z, w";
constexpr char kCwipcConvention[] =
    "trafo: world_from_camera, 4x4, row-major, metres. Camera: x right, y down, z forward. World: "
    "{}";

ordered_json IntrinsicsJson(const Intrinsics& k) {
  ordered_json json = {{"width", k.width}, {"height", k.height}, {"fx", k.fx},
                       {"fy", k.fy},       {"cx", k.cx},         {"cy", k.cy}};
  if (!k.distortion.empty()) json["distortion"] = k.distortion;
  return json;
}

/// A list of the sensors: what `pose_of` writes of each, its depth correction and its intrinsics.
template <class PoseOf>
ordered_json Sensors(const Poses& poses, bool with_intrinsics, const PoseOf& pose_of) {
  ordered_json sensors = ordered_json::array();
  for (const SensorPose& pose : poses) {
    ordered_json sensor = pose_of(pose);
    sensor["depth_gain"] = pose.depth_gain;
    sensor["depth_offset_m"] = pose.depth_offset_m;
    if (with_intrinsics && pose.intrinsics) sensor["intrinsics"] = IntrinsicsJson(*pose.intrinsics);
    sensors.push_back(std::move(sensor));
  }
  return sensors;
}

/// Files of earlier versions and other programs have no corrections.
SensorPose ReadSensor(const ObjectReader& object, const std::string& name, const Pose& pose,
                      bool with_intrinsics) {
  SensorPose sensor{name, pose};
  if (with_intrinsics && object.Has("intrinsics"))
    sensor.intrinsics = object.Read<Intrinsics>("intrinsics");
  object.OptionalSinceVersion("depth_gain", sensor.depth_gain);
  object.OptionalSinceVersion("depth_offset_m", sensor.depth_offset_m);
  return sensor;
}

/// The convention of a file with the world frame `world`.
std::string Convention(const char* poses, const std::string& world) {
  return fmt::format("{}; {}", fmt::format(fmt::runtime(poses), world), kDepthConvention);
}

ordered_json ColumnMajor(const Eigen::MatrixXd& matrix) {
  return std::vector<double>(matrix.data(), matrix.data() + matrix.size());
}

Eigen::MatrixXd FromColumnMajor(const ObjectReader& object, const std::string& key, int rows) {
  const std::vector<double> numbers = object.Read<std::vector<double>>(key);
  if (static_cast<int>(numbers.size()) != rows * rows)
    throw DataError(fmt::format("{}: {} numbers instead of {}", object.Place(key), numbers.size(),
                                rows * rows));
  return Eigen::Map<const Eigen::MatrixXd>(numbers.data(), rows, rows);
}

std::string FileText(const ordered_json& file) { return file.dump(2) + "\n"; }

Intrinsics Open3dIntrinsics(const ObjectReader& object) {
  const Eigen::MatrixXd matrix = FromColumnMajor(object, "intrinsic_matrix", 3);
  Intrinsics k{object.Read<int>("width"),
               object.Read<int>("height"),
               matrix(0, 0),
               matrix(1, 1),
               matrix(0, 2),
               matrix(1, 2),
               {}};
  k.Validate(object.where());
  return k;
}

}  // namespace

std::string WritePosesJson(const Poses& poses, const FileFrame& frame) {
  return FileText({{"format", kPosesFormat},
                   {"convention", Convention(kPosesConvention, frame.world)},
                   {"sensors", Sensors(poses, true, [](const SensorPose& pose) -> ordered_json {
                      return {{"name", pose.name},
                              {"structure_from_sensor", ToRows(pose.structure_from_sensor)}};
                    })}});
}

Poses ReadPosesJson(const std::string& text, const std::string& name) {
  const nlohmann::json document = ParseStrictJson(text, name);
  const ObjectReader root(document, name);
  if (root.Text("format") != kPosesFormat)
    throw DataError(fmt::format("{}: format \"{}\" instead of \"{}\"", name,
                                Shortened(root.Text("format")), kPosesFormat));
  root.Has("convention");
  Poses poses;
  for (const ObjectReader& sensor : root.Children("sensors")) {
    poses.push_back(
        ReadSensor(sensor, sensor.Text("name"), sensor.Read<Pose>("structure_from_sensor"), true));
    sensor.RejectOthers();
  }
  root.RejectOthers();
  return poses;
}

// Open3D reads only the keys that it knows, so names and the convention may be beside them.
std::string WriteOpen3d(const Poses& poses, const FileFrame& frame) {
  ordered_json parameters = ordered_json::array(), names = ordered_json::array();
  ordered_json gains = ordered_json::array(), offsets_m = ordered_json::array();
  for (const SensorPose& pose : poses) {
    const Intrinsics& k = *pose.intrinsics;
    Eigen::Matrix3d matrix;
    matrix << k.fx, 0, k.cx, 0, k.fy, k.cy, 0, 0, 1;
    names.push_back(pose.name);
    gains.push_back(pose.depth_gain);
    offsets_m.push_back(pose.depth_offset_m);
    parameters.push_back(
        {{"class_name", "PinholeCameraParameters"},
         {"extrinsic", ColumnMajor(pose.structure_from_sensor.inverse().matrix())},
         {"intrinsic",
          {{"height", k.height}, {"intrinsic_matrix", ColumnMajor(matrix)}, {"width", k.width}}},
         {"version_major", 1},
         {"version_minor", 0}});
  }
  return FileText({{"class_name", "PinholeCameraTrajectory"},
                   {"convention", Convention(kOpen3dConvention, frame.world)},
                   {"names", std::move(names)},
                   {"depth_gain", std::move(gains)},
                   {"depth_offset_m", std::move(offsets_m)},
                   {"parameters", std::move(parameters)},
                   {"version_major", 1},
                   {"version_minor", 0}});
}

Poses ReadOpen3d(const std::string& text, const std::string& name) {
  const nlohmann::json document = ParseStrictJson(text, name);
  const ObjectReader root(document, name);
  if (root.Text("class_name") != "PinholeCameraTrajectory")
    throw DataError(fmt::format("{}: class_name \"{}\" is no PinholeCameraTrajectory", name,
                                Shortened(root.Text("class_name"))));
  const std::vector<std::string> names =
      root.Has("names") ? root.Read<std::vector<std::string>>("names") : std::vector<std::string>{};
  const auto numbers = [&](const char* key) {
    return root.Has(key) ? root.Read<std::vector<double>>(key) : std::vector<double>{};
  };
  const std::vector<double> gains = numbers("depth_gain"), offsets_m = numbers("depth_offset_m");
  Poses poses;
  for (const ObjectReader& camera : root.Children("parameters")) {
    const Eigen::MatrixXd extrinsic = FromColumnMajor(camera, "extrinsic", 4);
    SensorPose pose;
    pose.name = poses.size() < names.size() ? names[poses.size()] : std::to_string(poses.size());
    pose.structure_from_sensor =
        PoseFromRotation(extrinsic.topLeftCorner<3, 3>(), extrinsic.topRightCorner<3, 1>(),
                         camera.Place("extrinsic"))
            .inverse();
    pose.intrinsics = Open3dIntrinsics(camera.Child("intrinsic"));
    if (poses.size() < gains.size()) pose.depth_gain = gains[poses.size()];
    if (poses.size() < offsets_m.size()) pose.depth_offset_m = offsets_m[poses.size()];
    poses.push_back(std::move(pose));
  }
  return poses;
}

std::string WriteUnity(const Poses& poses, const FileFrame& frame) {
  const auto pose_of = [](const SensorPose& pose) -> ordered_json {
    const Eigen::Vector3d p = UnityFromYUp() * pose.structure_from_sensor.translation();
    const Eigen::Quaterniond q = QuaternionOf(UnityFromYUp() * pose.structure_from_sensor.linear() *
                                              UnityCameraFromSensor());
    return {{"name", pose.name},
            {"position", {{"x", p.x()}, {"y", p.y()}, {"z", p.z()}}},
            {"rotation", {{"x", q.x()}, {"y", q.y()}, {"z", q.z()}, {"w", q.w()}}}};
  };
  return FileText({{"convention", Convention(kUnityConvention, frame.world)},
                   {"sensors", Sensors(poses, true, pose_of)}});
}

Poses ReadUnity(const std::string& text, const std::string& name) {
  const nlohmann::json document = ParseStrictJson(text, name);
  const ObjectReader root(document, name);
  Poses poses;
  for (const ObjectReader& sensor : root.Children("sensors")) {
    const ObjectReader p = sensor.Child("position"), q = sensor.Child("rotation");
    Pose pose = PoseFromQuaternion(
        q.Number("w"), q.Number("x"), q.Number("y"), q.Number("z"),
        UnityFromYUp() * Eigen::Vector3d(p.Number("x"), p.Number("y"), p.Number("z")),
        sensor.Place("rotation"));
    // Both changes of axes are their own inverse.
    pose.linear() = UnityFromYUp() * pose.linear() * UnityCameraFromSensor();
    poses.push_back(ReadSensor(sensor, sensor.Text("name"), pose, true));
  }
  return poses;
}

// cwipc (github.com/cwi-dis/cwipc): a camera has a serial number, a type and `trafo`; it skips keys
// that it does not know.
std::string WriteCwipc(const Poses& poses, const FileFrame& frame) {
  const auto pose_of = [](const SensorPose& pose) -> ordered_json {
    return {{"serial", pose.serial.empty() ? pose.name : pose.serial},
            {"name", pose.name},
            {"type", ""},
            {"trafo", ToRows(pose.structure_from_sensor)}};
  };
  return FileText({{"version", kCwipcVersion},
                   {"type", ""},
                   {"convention", Convention(kCwipcConvention, frame.world)},
                   {"camera", Sensors(poses, false, pose_of)}});
}

Poses ReadCwipc(const std::string& text, const std::string& name) {
  const nlohmann::json document = ParseStrictJson(text, name);
  const ObjectReader root(document, name);
  Poses poses;
  for (const ObjectReader& camera : root.Children("camera")) {
    const std::string serial = camera.Text("serial");
    poses.push_back(ReadSensor(camera, camera.Has("name") ? camera.Text("name") : serial,
                               camera.Read<Pose>("trafo"), false));
    poses.back().serial = serial;
  }
  return poses;
}

}  // namespace volalign::poses_internal
