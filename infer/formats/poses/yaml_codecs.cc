// Formats that are YAML: OpenCV's FileStorage and transforms of ROS.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/config/archive.h"
#include "core/config/bounded_yaml.h"
#include "infer/formats/poses/codecs.h"

namespace volalign::poses_internal {

namespace {

constexpr char kDepthFrame[] = "_depth_optical_frame";
constexpr char kColourFrame[] = "_color_optical_frame";

/// A number that YAML's readers, OpenCV's among them, read as a real one.
std::string Real(double value) {
  std::string text = fmt::format("{}", value);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

std::string Reals(const std::vector<double>& values) {
  std::vector<std::string> texts;
  texts.reserve(values.size());
  for (const double value : values) texts.push_back(Real(value));
  return fmt::format("{}", fmt::join(texts, ", "));
}

std::string OpencvMatrix(const std::string& key, const Eigen::MatrixXd& matrix) {
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = matrix;
  return fmt::format(
      "     {}: !!opencv-matrix\n        rows: {}\n        cols: {}\n"
      "        dt: d\n        data: [ {} ]\n",
      key, rows.rows(), rows.cols(),
      Reals(std::vector<double>(rows.data(), rows.data() + rows.size())));
}

/// A text in double quotes, as JSON and YAML both have it.
std::string Quoted(const std::string& text) { return nlohmann::json(text).dump(); }

Eigen::MatrixXd MatrixOf(const ObjectReader& matrix) {
  const int rows = matrix.Read<int>("rows"), cols = matrix.Read<int>("cols");
  const auto data = matrix.Read<std::vector<double>>("data");
  if (rows < 1 || cols < 1 ||
      data.size() != static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols))
    throw DataError(fmt::format("{}: {} numbers in {} rows and {} columns", matrix.where(),
                                data.size(), rows, cols));
  return Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      data.data(), rows, cols);
}

Eigen::MatrixXd MatrixOf(const ObjectReader& matrix, int rows, int cols) {
  const Eigen::MatrixXd of = MatrixOf(matrix);
  if (of.rows() != rows || of.cols() != cols)
    throw DataError(fmt::format("{}: {} x {} instead of {} x {}", matrix.where(), of.rows(),
                                of.cols(), rows, cols));
  return of;
}

Intrinsics OpencvIntrinsics(const ObjectReader& sensor) {
  const Eigen::MatrixXd matrix = MatrixOf(sensor.Child("camera_matrix"), 3, 3);
  Intrinsics k{sensor.Read<int>("image_width"),
               sensor.Read<int>("image_height"),
               matrix(0, 0),
               matrix(1, 1),
               matrix(0, 2),
               matrix(1, 2),
               {}};
  if (sensor.Has("distortion_coefficients")) {
    const Eigen::MatrixXd coefficients = MatrixOf(sensor.Child("distortion_coefficients"));
    k.distortion.assign(coefficients.data(), coefficients.data() + coefficients.size());
  }
  k.Validate(sensor.where());
  return k;
}

/// The frame of a sensor's camera. Throws ConfigError if that is the name of the world.
std::string FrameOf(const SensorPose& sensor, const FileFrame& frame) {
  const std::string name = sensor.name + (frame.colour ? kColourFrame : kDepthFrame);
  if (name == frame.name)
    throw ConfigError(fmt::format("the world's frame \"{}\" is that of a sensor", name));
  return name;
}

std::string RosTransform(const std::string& parent, const std::string& child, const Pose& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Quaterniond q = QuaternionOf(pose.linear());
  return fmt::format(
      "- header: {{frame_id: {}}}\n  child_frame_id: {}\n  transform:\n"
      "    translation: {{x: {}, y: {}, z: {}}}\n    rotation: {{x: {}, y: {}, z: {}, w: {}}}\n",
      Quoted(parent), Quoted(child), Real(t.x()), Real(t.y()), Real(t.z()), Real(q.x()),
      Real(q.y()), Real(q.z()), Real(q.w()));
}

/// Text of XML; in a comment, two hyphens do not follow each other.
std::string XmlText(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '&' || c == '<' || c == '>' || c == '"' || c == '-') {
      escaped += fmt::format("&#{};", static_cast<int>(c));
    } else {
      escaped += c;
    }
  }
  return escaped;
}
std::string XmlQuoted(const std::string& text) { return "\"" + XmlText(text) + "\""; }

/// URDF's angles, rad: R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Vector3d RollPitchYaw(const Eigen::Matrix3d& r) {
  const double level = std::hypot(r(0, 0), r(1, 0));
  const double pitch = std::atan2(-r(2, 0), level);
  if (level < 1e-9) return {std::atan2(-r(1, 2), r(1, 1)), pitch, 0};  // the other two are one turn
  return {std::atan2(r(2, 1), r(2, 2)), pitch, std::atan2(r(1, 0), r(0, 0))};
}

}  // namespace

// FileStorage needs its directive and three dashes first, then keys.
std::string WriteOpencv(const Poses& poses, const FileFrame& frame) {
  std::string text =
      "%YAML:1.0\n---\n"
      "convention: " +
      Quoted(
          "camera_from_world (solvePnP's direction): p_camera = R p_world + t, metres. Camera: x "
          "right, y down, z forward. World: " +
          frame.world +
          ". Pixel centres at integer coordinates. Distortion: k1 k2 p1 p2 k3 k4 k5 k6. " +
          kDepthConvention) +
      "\nsensors:\n";
  for (const SensorPose& pose : poses) {
    const Pose camera_from_world = pose.structure_from_sensor.inverse();
    text += "   -\n     name: " + Quoted(pose.name) + "\n";
    if (pose.intrinsics) {
      const Intrinsics& k = *pose.intrinsics;
      Eigen::Matrix3d matrix;
      matrix << k.fx, 0, k.cx, 0, k.fy, k.cy, 0, 0, 1;
      text += fmt::format("     image_width: {}\n     image_height: {}\n", k.width, k.height) +
              OpencvMatrix("camera_matrix", matrix);
      if (!k.distortion.empty()) {
        text +=
            OpencvMatrix("distortion_coefficients",
                         Eigen::Map<const Eigen::RowVectorXd>(
                             k.distortion.data(), static_cast<Eigen::Index>(k.distortion.size())));
      }
    }
    text += fmt::format("     depth_gain: {}\n     depth_offset_m: {}\n", Real(pose.depth_gain),
                        Real(pose.depth_offset_m));
    text += OpencvMatrix("R", camera_from_world.linear()) +
            OpencvMatrix("t", camera_from_world.translation());
  }
  return text;
}

Poses ReadOpencv(const std::string& text, const std::string& name) {
  // yaml-cpp knows no directive like OpenCV's.
  const std::size_t begin = text.find("---");
  if (begin == std::string::npos || text.compare(0, 5, "%YAML") != 0)
    throw DataError(name + ": no file of OpenCV's FileStorage");
  const nlohmann::json tree = YamlTree(text.substr(begin), name);
  Poses poses;
  for (const ObjectReader& sensor : ObjectReader(tree, name).Children("sensors")) {
    SensorPose pose;
    sensor.Renamed(pose.name = ScalarText(sensor.Get("name")));
    pose.structure_from_sensor = PoseFromRotation(MatrixOf(sensor.Child("R"), 3, 3),
                                                  MatrixOf(sensor.Child("t"), 3, 1), sensor.where())
                                     .inverse();
    sensor.OptionalSinceVersion("depth_gain", pose.depth_gain);
    sensor.OptionalSinceVersion("depth_offset_m", pose.depth_offset_m);
    if (sensor.Has("camera_matrix")) pose.intrinsics = OpencvIntrinsics(sensor);
    poses.push_back(std::move(pose));
  }
  return poses;
}

std::string WriteRos(const Poses& poses, const FileFrame& frame) {
  const char* optical = frame.colour ? kColourFrame : kDepthFrame;
  std::string text = fmt::format(
      "# geometry_msgs/TransformStamped: the pose of child_frame_id in header.frame_id, metres.\n"
      "# {}: {} (REP 103);\n"
      "# *{}: x right, y down, z forward. Rotations are quaternions.\n",
      frame.name, frame.world, optical);
  text += DepthComments(poses);
  for (const SensorPose& sensor : poses)
    text += RosTransform(frame.name, FrameOf(sensor, frame), sensor.structure_from_sensor);
  return text;
}

std::string WriteRosLaunch(const Poses& poses, const FileFrame& frame) {
  const char* optical = frame.colour ? kColourFrame : kDepthFrame;
  std::string text = fmt::format(
      "# ROS 2: ros2 launch THIS_FILE. Starts a publisher of the static transform of each sensor.\n"
      "# {}: {} (REP 103), metres.\n# *{}: x right, y down, z forward.\n{}"
      "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n\n\n"
      "def generate_launch_description():\n    return LaunchDescription([\n",
      frame.name, frame.world, optical, DepthComments(poses));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Pose& pose = poses[i].structure_from_sensor;
    const Eigen::Vector3d& t = pose.translation();
    const Eigen::Quaterniond q = QuaternionOf(pose.linear());
    text += fmt::format(
        "        Node(package=\"tf2_ros\", executable=\"static_transform_publisher\", "
        "name=\"volalign_tf_{}\",\n             arguments=[",
        i);
    const std::pair<const char*, double> numbers[] = {{"x", t.x()},  {"y", t.y()},  {"z", t.z()},
                                                      {"qx", q.x()}, {"qy", q.y()}, {"qz", q.z()},
                                                      {"qw", q.w()}};
    for (const auto& [key, value] : numbers)
      text += fmt::format("\"--{}\", \"{}\", ", key, Real(value));
    text += fmt::format("\"--frame-id\", {}, \"--child-frame-id\", {}]),\n", Quoted(frame.name),
                        Quoted(FrameOf(poses[i], frame)));
  }
  return text + "    ])\n";
}

std::string WriteUrdf(const Poses& poses, const FileFrame& frame) {
  const std::string parent = XmlQuoted(frame.name);
  std::string text = fmt::format(
      "<?xml version=\"1.0\"?>\n<!-- {}: {} (REP 103), metres. Sensors: x right, y down, z "
      "forward. "
      "-->\n<robot name=\"volalign\">\n  <link name={}/>\n",
      XmlText(frame.name), XmlText(frame.world), parent);
  for (const SensorPose& pose : poses) {
    const std::string child = XmlQuoted(FrameOf(pose, frame));
    const Eigen::Vector3d& t = pose.structure_from_sensor.translation();
    const Eigen::Vector3d rpy = RollPitchYaw(pose.structure_from_sensor.linear());
    text += fmt::format(
        "  <link name={0}/>\n  <joint name={1} type=\"fixed\">\n    <parent link={2}/>\n"
        "    <child link={0}/>\n    <origin xyz=\"{3} {4} {5}\" rpy=\"{6} {7} {8}\"/>\n"
        "  </joint>\n",
        child, XmlQuoted(pose.name + "_joint"), parent, Real(t.x()), Real(t.y()), Real(t.z()),
        Real(rpy.x()), Real(rpy.y()), Real(rpy.z()));
  }
  return text + "</robot>\n";
}

Poses ReadRos(const std::string& text, const std::string& name) {
  const nlohmann::json tree = {{"transforms", YamlTree(text, name)}};
  Poses poses;
  std::string world;
  for (const ObjectReader& transform : ObjectReader(tree, name).Children("transforms")) {
    std::string child = ScalarText(transform.Get("child_frame_id"));
    const std::string parent = ScalarText(transform.Child("header").Get("frame_id"));
    transform.Renamed(child);
    if (world.empty()) world = parent;
    if (parent != world)
      throw DataError(fmt::format("{}: in frame \"{}\", and others are in \"{}\"",
                                  transform.where(), Shortened(parent), Shortened(world)));
    const ObjectReader of = transform.Child("transform"), t = of.Child("translation"),
                       q = of.Child("rotation");
    const Pose pose =
        PoseFromQuaternion(q.Number("w"), q.Number("x"), q.Number("y"), q.Number("z"),
                           {t.Number("x"), t.Number("y"), t.Number("z")}, transform.where());
    for (const char* optical : {kDepthFrame, kColourFrame}) {
      const std::size_t end = child.rfind(optical);
      if (end != std::string::npos) child.resize(end);
    }
    poses.push_back({child, pose});
  }
  ReadDepthComments(text, name, &poses);
  return poses;
}

}  // namespace volalign::poses_internal
