#include "core/geometry/structure.h"

#include <fmt/format.h>

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
#include "core/config/config.h"
#include "core/geometry/stack_faults.h"

namespace volalign {

namespace {

constexpr double kTiltedStrip = 2e-3;  // m: strip width if a covering box is not parallel
constexpr double kMostStrips = 1e4;    // wider strips on sides of more than 20 m
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFarthest = 1e3;  // m, of a box from the structure's origin

struct FaceAxes {
  Eigen::Vector3d normal, u, v;
};

FaceAxes AxesOf(Face face) {
  const int axis = static_cast<int>(face) / 2;
  const auto unit = [axis](int k) { return Eigen::Vector3d::Unit((axis + k) % 3); };
  if (static_cast<int>(face) % 2 == 0) return {unit(0), unit(1), unit(2)};
  return {-unit(0), unit(2), unit(1)};
}

/// The part of the line origin + v * direction (in a box's frame) inside the box.
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

/// Cuts the side into strips along axis_v. Adds up the parts of each strip's middle line, kTouching
/// above the side, that other boxes leave. The strips end at the covering boxes' edges, so the sum
/// is exact for boxes parallel to the side. For others, strips are kTiltedStrip wide.
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
    std::vector<double> corners_u;
    for (const Eigen::Vector3d& corner : box.Corners()) {
      const Eigen::Vector3d p = corner - side->centre;
      const double height = p.dot(side->normal);
      nearest = std::min(nearest, height);
      farthest = std::max(farthest, height);
      corners_u.push_back(std::clamp(p.dot(side->axis_u), -side->half_u, side->half_u));
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
  side.name = box.name + "/" + ToString(face);
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

using Range = std::array<double, 2>;

/// A structure in a file; lengths in millimetres.
struct StructureFile {
  struct BoxEntry {
    std::string name;
    Range x{}, y{}, z{};
    double yaw_deg = 0;
    template <class Archive>
    void Describe(Archive& ar) {
      ar("name", name, "its name", Required());
      ar("x", x, "[min, max], mm", Required());
      ar("y", y, "[min, max], mm", Required());
      ar("z", z, "[min, max], mm", Required());
      ar("yaw_deg", yaw_deg, "turn about the vertical through the box's centre");
    }
  };
  struct LabelEntry {
    int id = 0;
    std::string side;
    template <class Archive>
    void Describe(Archive& ar) {
      ar("id", id, "from 1 on, without gaps", Required());
      ar("side", side, "BOX/SIDE", Required());
    }
  };
  struct Sides {
    std::array<std::string, 6> normals{"+x", "-x", "+y", "-y", "+z", "-z"};
    template <class Archive>
    void Describe(Archive& ar) {
      for (const Face face : kFaces) {
        std::string& normal = normals.at(static_cast<std::size_t>(face));
        ar(ToString(face), normal, "its normal, which is fixed", OneOf({normal}));
      }
    }
  };
  std::string name;
  std::vector<BoxEntry> boxes;
  Sides sides;
  std::vector<LabelEntry> labels;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "of the structure");
    ar("boxes", boxes, "a list of {name, x, y, z}", Required());
    ar("sides", sides, "the normals of the sides");
    ar("labels", labels, "the sides in the order of their labels");
  }
};

Box BoxOf(const StructureFile::BoxEntry& entry, const ConfigSource& source,
          const std::string& key) {
  Eigen::Vector3d min, max;
  const std::array<const Range*, 3> ranges = {&entry.x, &entry.y, &entry.z};
  for (int i = 0; i < 3; ++i) {
    const auto& [low, high] = *ranges.at(static_cast<std::size_t>(i));
    const std::string axis = fmt::format("{}.{}", key, "xyz"[i]);
    if (!(low < high)) {
      throw ConfigError(fmt::format("{0} = [{1}, {2}] of box '{3}' violates min < max ({4})", axis,
                                    low, high, Shortened(entry.name), source.WhereOf(axis)));
    }
    min[i] = low * kMillimetre;
    max[i] = high * kMillimetre;
  }
  Box box = Box::FromMinMax(entry.name, min, max);
  box.structure_from_box.linear() =
      RotationExp(entry.yaw_deg * M_PI / 180 * Eigen::Vector3d::UnitY());
  return box;
}

}  // namespace

Structure ReadStructure(const std::filesystem::path& file_path) {
  const std::string path = file_path.string(), ending = file_path.extension().string();
  if (ending == ".glb") {
    throw ConfigError(fmt::format(
        "{}: a .glb shows a structure and is not read; give the .yaml that it was built "
        "from, as --structure FILE.yaml or in the place of its name in capture.json",
        path));
  }
  if (ending != ".yaml" && ending != ".yml")
    throw ConfigError(fmt::format("{}: a structure is a .yaml file", path));
  const auto source = ConfigSource::FromString(ReadFile(FindInputFile(path), kMaxTextBytes), path);
  StructureFile start;
  start.name = file_path.stem().string();
  const StructureFile file = ReadConfig(source, start);
  std::vector<Box> boxes;
  for (const StructureFile::BoxEntry& entry : file.boxes)
    boxes.push_back(BoxOf(entry, source, fmt::format("boxes[{}]", boxes.size())));
  std::vector<std::string> order;
  for (const StructureFile::LabelEntry& label : file.labels) {
    order.push_back(label.side);
    if (label.id != static_cast<int>(order.size())) {
      throw ConfigError(fmt::format(
          "label id {} where {} is expected; ids run from 1 without gaps ({})", label.id,
          order.size(), source.WhereOf(fmt::format("labels[{}].id", order.size() - 1))));
    }
  }
  try {
    Structure structure = Structure::FromBoxes(file.name, std::move(boxes), order);
    RequireStack(structure);
    return structure;
  } catch (const DataError& e) {
    throw ConfigError(fmt::format("{}: {}", path, e.what()));
  }
}

std::string StructureYaml(const Structure& structure) {
  const auto rounded = [](double mm) { return std::round(mm * 1e6) / 1e6; };
  StructureFile file;
  file.name = structure.name();
  for (const Box& box : structure.boxes()) {
    const Eigen::Matrix3d r = box.structure_from_box.linear();
    if (r(1, 1) < 1 - 1e-9) {
      throw DataError(fmt::format("box '{}' leans; the boxes of a structure file stand upright",
                                  Shortened(box.name)));
    }
    StructureFile::BoxEntry& entry = file.boxes.emplace_back();
    entry.name = box.name;
    entry.yaw_deg = rounded(std::atan2(r(0, 2), r(2, 2)) * 180 / M_PI);
    const Eigen::Vector3d middle = box.structure_from_box.translation();
    const Eigen::Vector3d low = (middle - box.size / 2) / kMillimetre,
                          high = (middle + box.size / 2) / kMillimetre;
    entry.x = {rounded(low.x()), rounded(high.x())};
    entry.y = {rounded(low.y()), rounded(high.y())};
    entry.z = {rounded(low.z()), rounded(high.z())};
  }
  for (const std::string& side : structure.SideNames())
    file.labels.push_back({static_cast<int>(file.labels.size()) + 1, side});
  return WriteConfig(file);
}

}  // namespace volalign
