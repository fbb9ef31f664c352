#include "core/geometry/structure.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"
#include "core/geometry/stack_faults.h"

namespace volalign {

namespace {

constexpr double kTiltedStrip = 2e-3;  // m: strip width where a covering box stands askew
constexpr double kMostStrips = 1e4;    // wider strips on sides of more than 20 m
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFarthest = 1e3;  // m, of a box from the structure's origin

struct FaceAxes {
  Eigen::Vector3d normal, u, v;
};

FaceAxes AxesOf(Face face) {
  using V = Eigen::Vector3d;
  switch (face) {
    case Face::kFront:
      return {V::UnitX(), V::UnitY(), V::UnitZ()};
    case Face::kBack:
      return {-V::UnitX(), V::UnitZ(), V::UnitY()};
    case Face::kUp:
      return {V::UnitY(), V::UnitZ(), V::UnitX()};
    case Face::kDown:
      return {-V::UnitY(), V::UnitX(), V::UnitZ()};
    case Face::kRight:
      return {V::UnitZ(), V::UnitX(), V::UnitY()};
    case Face::kLeft:
      return {-V::UnitZ(), V::UnitY(), V::UnitX()};
  }
  throw Error("unknown face");
}

/// The part of the line origin + v * direction (in a box's frame) that lies inside the box.
std::pair<double, double> InsideBox(const Eigen::Vector3d& half, const Eigen::Vector3d& origin,
                                    const Eigen::Vector3d& direction) {
  double low = -std::numeric_limits<double>::infinity(), high = -low;
  for (int i = 0; i < 3; ++i) {
    if (std::abs(direction[i]) < 1e-12) {
      if (std::abs(origin[i]) > half[i]) return {0, 0};
      continue;
    }
    const double a = (-half[i] - origin[i]) / direction[i];
    const double b = (half[i] - origin[i]) / direction[i];
    low = std::max(low, std::min(a, b));
    high = std::min(high, std::max(a, b));
  }
  return {low, high};
}

/// Cuts the side into strips along axis_v and adds up what the other boxes leave of each strip's
/// middle line, kTouching above the side. The strips end at the covering boxes' edges, which makes
/// the sum exact for boxes parallel to the side; where one stands askew they are kTiltedStrip wide.
void ComputeExposure(const std::vector<Box>& boxes, Side* side) {
  struct Cover {
    Eigen::Vector3d half, centre, axis_u, axis_v;  // of the side, in the covering box's frame
  };
  std::vector<Cover> covers;
  std::vector<double> cuts{-side->half_u, side->half_u};
  bool tilted = false;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    if (static_cast<int>(b) == side->box) continue;
    const Box& box = boxes[b];
    double nearest = 1e9, farthest = -1e9;
    std::array<double, 8> corners_u;
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d sign((corner & 1) ? 1 : -1, (corner & 2) ? 1 : -1,
                                 (corner & 4) ? 1 : -1);
      const Eigen::Vector3d p =
          box.structure_from_box * Eigen::Vector3d(sign.cwiseProduct(box.size) / 2) - side->centre;
      const double height = p.dot(side->normal);
      nearest = std::min(nearest, height);
      farthest = std::max(farthest, height);
      corners_u[static_cast<std::size_t>(corner)] =
          std::clamp(p.dot(side->axis_u), -side->half_u, side->half_u);
    }
    if (nearest > kTouching || farthest < kTouching) continue;
    const Pose box_from_structure = box.structure_from_box.inverse();
    const Cover cover{box.size / 2, box_from_structure * (side->centre + kTouching * side->normal),
                      box_from_structure.linear() * side->axis_u,
                      box_from_structure.linear() * side->axis_v};
    tilted = tilted || cover.axis_u.cwiseAbs().maxCoeff() < 1 - 1e-9 ||
             cover.axis_v.cwiseAbs().maxCoeff() < 1 - 1e-9;
    covers.push_back(cover);
    cuts.insert(cuts.end(), corners_u.begin(), corners_u.end());
  }
  if (tilted) {
    const int n =
        static_cast<int>(std::min(std::ceil(2 * side->half_u / kTiltedStrip), kMostStrips));
    for (int i = 1; i < n; ++i) cuts.push_back(-side->half_u + 2 * side->half_u * i / n);
  }
  std::sort(cuts.begin(), cuts.end());

  double area = 0, moment_u = 0, moment_v = 0;
  std::vector<std::pair<double, double>> covered;
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
    const double width = cuts[i + 1] - cuts[i], u = 0.5 * (cuts[i] + cuts[i + 1]);
    if (width < 1e-9) continue;
    covered.clear();
    for (const Cover& cover : covers) {
      const auto [low, high] = InsideBox(cover.half, cover.centre + u * cover.axis_u, cover.axis_v);
      const double begin = std::max(low, -side->half_v), end = std::min(high, side->half_v);
      if (begin < end) covered.emplace_back(begin, end);
    }
    std::sort(covered.begin(), covered.end());
    double at = -side->half_v;
    const auto add_until = [&](double end) {
      if (end <= at) return;
      area += width * (end - at);
      moment_u += width * (end - at) * u;
      moment_v += width * (end - at) * 0.5 * (end + at);
    };
    for (const auto& [begin, end] : covered) {
      add_until(begin);
      at = std::max(at, end);
    }
    add_until(side->half_v);
  }
  side->exposed_area = area;
  side->exposed_centroid = side->centre;
  if (area > 1e-9) {
    side->exposed_centroid += moment_u / area * side->axis_u + moment_v / area * side->axis_v;
  }
}

Side MakeSide(const std::vector<Box>& boxes, int box_index, Face face) {
  const Box& box = boxes[static_cast<std::size_t>(box_index)];
  const FaceAxes axes = AxesOf(face);
  Side side;
  side.name = box.name + "/" + FaceName(face);
  side.box = box_index;
  side.face = face;
  const Eigen::Matrix3d& r = box.structure_from_box.linear();
  side.normal = r * axes.normal;
  side.axis_u = r * axes.u;
  side.axis_v = r * axes.v;
  side.half_u = std::abs(box.size.dot(axes.u)) / 2;
  side.half_v = std::abs(box.size.dot(axes.v)) / 2;
  side.centre = box.structure_from_box *
                Eigen::Vector3d(axes.normal * std::abs(box.size.dot(axes.normal)) / 2);
  return side;
}

}  // namespace

const char* FaceName(Face face) {
  constexpr const char* kNames[] = {"front", "back", "up", "down", "right", "left"};
  return kNames[static_cast<int>(face)];
}

Eigen::Vector3d FaceNormal(Face face) { return AxesOf(face).normal; }

Box Box::FromMinMax(std::string name, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
  Box box;
  box.name = std::move(name);
  box.size = max - min;
  box.structure_from_box.translation() = (min + max) / 2;
  return box;
}

std::array<Eigen::Vector3d, 8> Box::Corners() const {
  std::array<Eigen::Vector3d, 8> corners;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Eigen::Vector3d sign(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
    corners[k] = structure_from_box * Eigen::Vector3d(sign.cwiseProduct(size) / 2);
  }
  return corners;
}

double Side::BulgeAt(const Eigen::Vector3d& p) const {
  const auto rise = [&](const Eigen::Vector3d& axis, double half) {
    return std::cos(M_PI_2 * std::clamp(axis.dot(p - centre) / half, -1.0, 1.0));
  };
  return rise(axis_u, half_u) * rise(axis_v, half_v);
}

Eigen::Vector3d Side::ClosestPoint(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d d = p - centre;
  return centre + std::clamp(d.dot(axis_u), -half_u, half_u) * axis_u +
         std::clamp(d.dot(axis_v), -half_v, half_v) * axis_v;
}

Structure Structure::FromBoxes(std::string name, std::vector<Box> boxes,
                               const std::vector<std::string>& label_order) {
  if (boxes.empty()) throw DataError("a structure needs at least one box");
  if (static_cast<int>(boxes.size()) > kMaxBoxes) {
    throw DataError(fmt::format("{} boxes violate boxes <= {} (labels are 8-bit, 5 per box)",
                                boxes.size(), kMaxBoxes));
  }
  RequirePlainName(name, "a structure");
  std::set<std::string> names;
  for (const Box& box : boxes) {
    RequirePlainName(box.name, "a box");
    if (box.name.empty() || box.name.find('/') != std::string::npos) {
      throw DataError(fmt::format("box name '{}' is empty or holds a '/'", Shortened(box.name)));
    }
    if (!names.insert(box.name).second) {
      throw DataError(
          fmt::format("two boxes are named '{}'; names have to be unique", Shortened(box.name)));
    }
    const Eigen::Vector3d mm = box.size * 1e3;
    if (!mm.allFinite() || mm.minCoeff() < kShortestEdge * 1e3 ||
        mm.maxCoeff() > kLongestEdge * 1e3) {
      throw DataError(fmt::format(
          "box '{}' is {:g} x {:g} x {:g} mm; every edge has to be from {:g} mm to {:g} m: sizes "
          "are written in millimetres",
          Shortened(box.name), mm.x(), mm.y(), mm.z(), kShortestEdge * 1e3, kLongestEdge));
    }
    if (!box.structure_from_box.matrix().allFinite() ||
        box.structure_from_box.translation().norm() > kFarthest) {
      throw DataError(fmt::format(
          "box '{}' has a pose that is not finite, or is more than {:g} m away; positions are "
          "written in millimetres",
          Shortened(box.name), kFarthest));
    }
  }

  Structure structure;
  structure.name_ = std::move(name);
  structure.boxes_ = std::move(boxes);
  for (int b = 0; b < static_cast<int>(structure.boxes_.size()); ++b) {
    for (const Face face : kFaces) {
      Side side = MakeSide(structure.boxes_, b, face);
      ComputeExposure(structure.boxes_, &side);
      structure.sides_.push_back(std::move(side));
    }
  }

  std::map<std::string, int> index_of;
  std::vector<std::string> order = label_order;
  for (int i = 0; i < static_cast<int>(structure.sides_.size()); ++i) {
    const Side& side = structure.sides_[static_cast<std::size_t>(i)];
    if (side.face == Face::kDown) continue;
    index_of[side.name] = i;
    if (label_order.empty()) order.push_back(side.name);
  }
  structure.side_of_label_.assign(1, -1);
  for (const std::string& side_name : order) {
    const auto found = index_of.find(side_name);
    if (found == index_of.end()) {
      throw DataError(fmt::format(
          "label {} names the side '{}', which does not exist, is a `down` side or is listed twice",
          structure.side_of_label_.size(), Shortened(side_name)));
    }
    structure.sides_[static_cast<std::size_t>(found->second)].label =
        static_cast<std::uint8_t>(structure.side_of_label_.size());
    structure.side_of_label_.push_back(found->second);
    index_of.erase(found);
  }
  if (!index_of.empty()) {
    throw DataError(fmt::format("side '{}' has no label", index_of.begin()->first));
  }
  structure.num_classes_ = static_cast<int>(structure.side_of_label_.size());
  return structure;
}

const Side& Structure::SideOfLabel(int label) const {
  if (label < 1 || label >= num_classes_) {
    throw Error(fmt::format("label {} violates 1 <= label < {}", label, num_classes_));
  }
  return sides_[static_cast<std::size_t>(side_of_label_[static_cast<std::size_t>(label)])];
}

const Eigen::Vector3d& Structure::Keypoint(int label, KeypointKind kind) const {
  const Side& side = SideOfLabel(label);
  return kind == KeypointKind::kCentre ? side.centre : side.exposed_centroid;
}

namespace {

double ExtremeHeight(const std::vector<Box>& boxes, double sign) {
  double extreme = -1e9;
  for (const Box& box : boxes) {
    const double reach = box.structure_from_box.linear().row(1).cwiseAbs().dot(box.size) / 2;
    extreme = std::max(extreme, sign * box.structure_from_box.translation().y() + reach);
  }
  return sign * extreme;
}

}  // namespace

double Structure::FloorHeight() const { return ExtremeHeight(boxes_, -1); }

double Structure::Height() const { return ExtremeHeight(boxes_, 1) - FloorHeight(); }

std::string Structure::Hash() const {
  std::string text;
  for (const Box& box : boxes_) {
    text += box.name + ":";
    for (int i = 0; i < 3; ++i) text += fmt::format("{} ", std::llround(box.size[i] * 1e6));
    for (const auto& row : ToRows(box.structure_from_box)) {
      for (const double x : row) text += fmt::format("{} ", std::llround(x * 1e6));
    }
  }
  for (const std::string& side : SideNames()) text += side + ";";
  return Sha256(text);
}

std::vector<std::string> Structure::SideNames() const {
  std::vector<std::string> names;
  for (int label = 1; label < num_classes_; ++label) names.push_back(SideOfLabel(label).name);
  return names;
}

Structure Structure::Displaced(const std::vector<Pose>& offsets, double size_scale) const {
  Structure moved = DisplacedToDraw(offsets, size_scale);
  for (Side& side : moved.sides_) ComputeExposure(moved.boxes_, &side);
  return moved;
}

Structure Structure::DisplacedToDraw(const std::vector<Pose>& offsets, double size_scale) const {
  if (offsets.size() != boxes_.size()) {
    throw Error(fmt::format("Displaced: {} offsets for {} boxes", offsets.size(), boxes_.size()));
  }
  std::vector<Box> boxes = boxes_;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    boxes[b].size *= size_scale;
    boxes[b].structure_from_box = offsets[b] * boxes[b].structure_from_box;
  }
  Structure moved = *this;
  moved.boxes_ = boxes;
  for (Side& side : moved.sides_) {
    const std::uint8_t label = side.label;
    side = MakeSide(moved.boxes_, side.box, side.face);
    side.label = label;
    side.exposed_area = kNan;
    side.exposed_centroid.setConstant(kNan);
  }
  return moved;
}

namespace {

constexpr double kMillimetre = 1e-3;

void RejectOtherKeys(const YAML::Node& node, const std::set<std::string>& known,
                     const std::string& path) {
  std::set<std::string> seen;
  for (const auto& item : node) {
    const auto key = item.first.as<std::string>();
    const std::string where = fmt::format("{}:{}", path, item.first.Mark().line + 1);
    if (!known.count(key))
      throw ConfigError(fmt::format("{}: unknown key '{}'", where, Shortened(key)));
    if (!seen.insert(key).second)
      throw ConfigError(fmt::format("{}: key '{}' stands twice", where, Shortened(key)));
  }
}

/// What is at `where`, "FILE:LINE"; `what` says which value it is, `expected` what it has to be.
template <class T>
T ReadValue(const YAML::Node& node, const std::string& where, const std::string& what,
            const char* expected) {
  try {
    return node.as<T>();
  } catch (const YAML::BadConversion&) {
    throw ConfigError(fmt::format("{}: {} has to be {}; it is {}", where, what, expected,
                                  Shortened(YAML::Dump(node))));
  }
}

Box ReadBox(const YAML::Node& node, const std::string& path) {
  const std::string where = fmt::format("{}:{}", path, node.Mark().line + 1);
  if (!node.IsMap())
    throw ConfigError(where + ": a box wants {name, x: [min, max], y: ..., z: ...}");
  RejectOtherKeys(node, {"name", "x", "y", "z", "yaw_deg"}, path);
  if (!node["name"]) throw ConfigError(where + ": a box has no 'name'");
  const auto name = ReadValue<std::string>(node["name"], where, "'name' of a box", "a word");
  const auto value = [&](const std::string& key) {
    return fmt::format("'{}' of box '{}'", key, Shortened(name));
  };
  Eigen::Vector3d min, max;
  const char* axes[] = {"x", "y", "z"};
  for (int i = 0; i < 3; ++i) {
    const YAML::Node axis = node[axes[i]];
    if (!axis)
      throw ConfigError(fmt::format("{}: box '{}' has no '{}'", where, Shortened(name), axes[i]));
    const std::string at = fmt::format("{}:{}", path, axis.Mark().line + 1);
    constexpr char kExpected[] = "two numbers, [min, max], in millimetres, with a comma between";
    const auto range = ReadValue<std::vector<double>>(axis, at, value(axes[i]), kExpected);
    if (range.size() != 2 || !(range[0] < range[1])) {
      throw ConfigError(fmt::format("{}: {} has to be {}, and min < max; it is {}", at,
                                    value(axes[i]), kExpected, Shortened(YAML::Dump(axis))));
    }
    min[i] = range[0] * kMillimetre;
    max[i] = range[1] * kMillimetre;
  }
  Box box = Box::FromMinMax(name, min, max);
  if (const YAML::Node given = node["yaw_deg"]) {
    const double yaw = ReadValue<double>(given, where, value("yaw_deg"), "a number of degrees") *
                       (3.14159265358979323846 / 180);
    box.structure_from_box.linear() = RotationExp(yaw * Eigen::Vector3d::UnitY());
  }
  return box;
}

}  // namespace

Structure ReadStructureYaml(const std::string& path) {
  const std::string text = ReadFile(FindInputFile(path), kMaxTextBytes);
  try {
    const YAML::Node root = LoadYaml(text);
    if (!root.IsMap() || !root["boxes"] || !root["boxes"].IsSequence()) {
      throw ConfigError(path + ": a structure wants `boxes:`, a list of {name, x, y, z}");
    }
    RejectOtherKeys(root, {"name", "boxes", "sides", "labels"}, path);
    if (root["sides"]) {
      const std::map<std::string, std::string> expected = {{"front", "+x"}, {"back", "-x"},
                                                           {"up", "+y"},    {"down", "-y"},
                                                           {"right", "+z"}, {"left", "-z"}};
      for (const auto& item : root["sides"]) {
        const auto face = expected.find(item.first.as<std::string>());
        if (face == expected.end() || face->second != item.second.as<std::string>()) {
          throw ConfigError(
              fmt::format("{}:{}: the side names' normals are fixed: front +x, back -x, up +y, "
                          "down -y, right +z, left -z",
                          path, item.first.Mark().line + 1));
        }
      }
    }
    std::vector<Box> boxes;
    for (const YAML::Node& node : root["boxes"]) boxes.push_back(ReadBox(node, path));
    std::vector<std::string> order;
    for (const YAML::Node& node : root["labels"]) {
      RejectOtherKeys(node, {"id", "side"}, path);
      const std::string where = fmt::format("{}:{}", path, node.Mark().line + 1);
      const int id = ReadValue<int>(node["id"], where, "'id' of a label", "a whole number");
      if (id != static_cast<int>(order.size()) + 1) {
        throw ConfigError(
            fmt::format("{}: label id {} where {} is expected; ids run from 1 without gaps", where,
                        id, order.size() + 1));
      }
      order.push_back(ReadValue<std::string>(node["side"], where, "'side' of a label", "BOX/SIDE"));
    }
    const std::string name =
        root["name"] ? root["name"].as<std::string>() : std::filesystem::path(path).stem().string();
    Structure structure = Structure::FromBoxes(name, std::move(boxes), order);
    RequireStack(structure);
    return structure;
  } catch (const YAML::Exception& e) {
    throw ConfigError(fmt::format("{}:{}: {}", path, e.mark.line + 1, YamlProblem(e)));
  } catch (const DataError& e) {
    throw ConfigError(fmt::format("{}: {}", path, e.what()));
  }
}

}  // namespace volalign
