#include "infer/report/clouds.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>

#include "core/base/file_util.h"
#include "core/formats/gltf_parts.h"
#include "core/geometry/visibility.h"
#include "core/plot/picture.h"
#include "infer/report/panels.h"
#include "infer/view/sensor_view.h"

namespace volalign {

namespace {

/// Appends a value's bytes, little-endian first.
template <class T>
void Append(std::string* bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof(T));
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
  std::reverse(raw.begin(), raw.end());
#endif
  bytes->append(raw.data(), raw.size());
}

}  // namespace

std::vector<AlignedPoint> AlignedPoints(const FrameResult& sensor, const Structure& structure) {
  std::vector<AlignedPoint> points;
  if (!sensor.structure_from_sensor) return points;
  const SensorView view = Corrected(sensor.view, sensor.depth_gain, sensor.depth_offset_m);
  const Image<float> residuals = SideResiduals(sensor, structure);
  constexpr double kMostRadius = 3;  // m
  constexpr Rgb kBackground{150, 150, 150};
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = *sensor.structure_from_sensor * view.Point(u, v);
      if (std::hypot(p.x(), p.z()) > kMostRadius) continue;
      AlignedPoint point;
      point.p = p.cast<float>();
      point.label = sensor.segmentation.labels(u, v);
      point.confidence = sensor.segmentation.confidence(u, v);
      const bool side = point.label > 0 && point.label < structure.num_classes();
      point.colour = side ? LabelColour(point.label) : kBackground;
      point.residual =
          static_cast<float>(side ? (structure.SideOfLabel(point.label).ClosestPoint(p) - p).norm()
                                  : DistanceToSurface(structure, p).distance);
      point.side_residual = residuals(u, v);
      points.push_back(point);
    }
  }
  return points;
}

void WritePly(const std::filesystem::path& path, const std::vector<AlignedPoint>& points,
              const std::optional<WorldFrame>& world) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\n"
      "comment volalign: {}, metres; residual: distance to the labelled side\n"
      "element vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property uchar label\nproperty float confidence\nproperty float residual\nend_header\n",
      world ? "frame of " + world->name : "structure frame, y up", points.size());
  constexpr std::size_t kBytesAPoint = 24;
  bytes.reserve(bytes.size() + kBytesAPoint * points.size());
  for (const AlignedPoint& point : points) {
    Eigen::Vector3f p = point.p;
    if (world) p = (world->world_from_structure * p.cast<double>()).cast<float>();
    for (int i = 0; i < 3; ++i) Append(&bytes, p[i]);
    Append(&bytes, point.colour.r);
    Append(&bytes, point.colour.g);
    Append(&bytes, point.colour.b);
    Append(&bytes, point.label);
    Append(&bytes, point.confidence);
    Append(&bytes, point.residual);
  }
  WriteFileAtomically(path, bytes);
}

namespace {

constexpr double kPyramidLength = 0.3;  // m

using Value = tinygltf::Value;

Value SensorExtras(const Extrinsics::Sensor& sensor) {
  Value::Object extras;
  extras["status"] = Value(std::string(ToString(sensor.status)));
  std::vector<double> pose;
  for (int i = 0; i < 16; ++i) pose.push_back(sensor.structure_from_sensor->matrix()(i / 4, i % 4));
  extras["structure_from_sensor"] = Numbers(pose);
  const Intrinsics& k = sensor.intrinsics;
  Value::Object intrinsics;
  intrinsics["width"] = Value(k.width);
  intrinsics["height"] = Value(k.height);
  intrinsics["fx"] = Value(k.fx);
  intrinsics["fy"] = Value(k.fy);
  intrinsics["cx"] = Value(k.cx);
  intrinsics["cy"] = Value(k.cy);
  if (!k.distortion.empty()) intrinsics["distortion"] = Numbers(k.distortion);
  extras["intrinsics"] = Value(std::move(intrinsics));
  return Value(std::move(extras));
}

int AddCamera(tinygltf::Model* model, const Extrinsics::Sensor& sensor) {
  const Intrinsics& k = sensor.intrinsics;
  tinygltf::Camera camera;
  camera.name = sensor.name + " camera";  // some readers mix up a camera and a node of one name
  camera.type = "perspective";
  camera.perspective.yfov = 2 * std::atan(k.height / (2 * k.fy));
  camera.perspective.aspectRatio = (k.width / k.fx) / (k.height / k.fy);
  camera.perspective.znear = 0.1;
  camera.perspective.zfar = 20;
  model->cameras.push_back(std::move(camera));
  return static_cast<int>(model->cameras.size()) - 1;
}

/// Edges of the view's pyramid, in the axes of a glTF camera.
int AddPyramid(tinygltf::Model* model, const Extrinsics::Sensor& sensor) {
  const Intrinsics& k = sensor.intrinsics;
  std::vector<float> positions = {0, 0, 0};
  for (const auto& [u, v] : {std::pair(-0.5, -0.5),
                             {k.width - 0.5, -0.5},
                             {k.width - 0.5, k.height - 0.5},
                             {-0.5, k.height - 0.5}}) {
    positions.push_back(static_cast<float>(kPyramidLength * (u - k.cx) / k.fx));
    positions.push_back(static_cast<float>(-kPyramidLength * (v - k.cy) / k.fy));
    positions.push_back(static_cast<float>(-kPyramidLength));
  }
  tinygltf::Primitive lines;
  lines.mode = TINYGLTF_MODE_LINE;
  lines.attributes["POSITION"] = AddPositions(model, positions);
  lines.indices = AddAccessor<std::uint16_t>(
      model, {0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1}, TINYGLTF_TYPE_SCALAR);
  tinygltf::Mesh mesh;
  mesh.name = sensor.name + " view";
  mesh.primitives.push_back(std::move(lines));
  return AddMesh(model, std::move(mesh));
}

/// The camera is a child: some programs show a node's mesh or its camera, not both.
int AddSensor(tinygltf::Model* model, const Extrinsics::Sensor& sensor) {
  tinygltf::Node camera;
  camera.name = sensor.name + " camera";
  camera.camera = AddCamera(model, sensor);
  tinygltf::Node node;
  node.name = sensor.name;
  node.mesh = AddPyramid(model, sensor);
  Pose flip = Pose::Identity();
  flip.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  SetPose(&node, *sensor.structure_from_sensor * flip);
  node.extras = SensorExtras(sensor);
  node.children = {AddNode(model, std::move(camera))};
  return AddNode(model, std::move(node));
}

int AddCloud(tinygltf::Model* model, const RigCloud& cloud) {
  std::vector<float> positions;
  std::vector<std::uint8_t> colours;
  for (const AlignedPoint& point : cloud.points) {
    for (int i = 0; i < 3; ++i) positions.push_back(point.p[i]);
    for (const std::uint8_t byte :
         {point.colour.r, point.colour.g, point.colour.b, std::uint8_t{255}}) {
      colours.push_back(byte);
    }
  }
  tinygltf::Primitive points;
  points.mode = TINYGLTF_MODE_POINTS;
  points.attributes["POSITION"] = AddPositions(model, positions);
  points.attributes["COLOR_0"] = AddAccessor(model, colours, TINYGLTF_TYPE_VEC4);
  tinygltf::Mesh mesh;
  mesh.name = cloud.sensor + " points" + (cloud.capture.empty() ? "" : " in " + cloud.capture);
  mesh.primitives.push_back(std::move(points));
  tinygltf::Node node;
  node.name = mesh.name;
  node.mesh = AddMesh(model, std::move(mesh));
  return AddNode(model, std::move(node));
}

}  // namespace

void WriteRigGlb(const std::filesystem::path& path, const Extrinsics& extrinsics,
                 const std::vector<Structure>& structures, const std::vector<RigCloud>& clouds) {
  tinygltf::Model model = NewGltf("rig");
  std::vector<int>& roots = model.scenes[0].nodes;
  for (std::size_t s = 0; s < structures.size(); ++s) {
    const bool known = s < extrinsics.placements.size();
    if (s > 0 && (!known || extrinsics.placements[s].sensors.empty())) continue;
    tinygltf::Node stack;
    stack.name = structures[s].name();
    if (s > 0) {
      stack.name += " in " + extrinsics.placements[s].name;
      SetPose(&stack, extrinsics.placements[s].first_from_placement);
    }
    stack.children = AddBoxes(&model, structures[s]);
    roots.push_back(AddNode(&model, std::move(stack)));
  }
  for (const Extrinsics::Sensor& sensor : extrinsics.sensors) {
    if (sensor.structure_from_sensor) roots.push_back(AddSensor(&model, sensor));
  }
  for (const RigCloud& cloud : clouds) {
    if (!cloud.points.empty()) roots.push_back(AddCloud(&model, cloud));
  }
  WriteGlb(path, model);
}

}  // namespace volalign
