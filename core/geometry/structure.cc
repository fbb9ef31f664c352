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
#include "core/geometry/mesh_file.h"
#include "core/geometry/stack_faults.h"

namespace volalign {

namespace {

constexpr double kTiltedStrip = 2e-3;  // m: strip width if a covering box is not parallel
constexpr double kMostStrips = 1e4;    // wider strips on sides of more than 20 m
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFarthest = 1e3;  // m, of a box from the structure's origin

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

/// A side of a mesh, or one that a mesh may cover: by the middles of the cells of a grid.
void ComputeExposureByGrid(const std::vector<Box>& boxes, Side* side) {
  const double scale = side->outline_scale;
  std::vector<const Box*> near;  // that reach in front of it
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    if (static_cast<int>(b) == side->box) continue;
    const auto corners = boxes[b].Corners();
    if (std::any_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& p) {
          return side->normal.dot(p - side->centre) > 0;
        }))
      near.push_back(&boxes[b]);
  }
  const std::vector<Eigen::Vector2d> cells =
      side->outline ? side->outline->open_cells : GridOver(side->half_u, side->half_v);
  int exposed = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& cell : cells) {
    const Eigen::Vector2d at = scale * cell;
    const Eigen::Vector3d p =
        side->centre + at.x() * side->axis_u + at.y() * side->axis_v + kTouching * side->normal;
    if (std::any_of(near.begin(), near.end(), [&](const Box* box) { return box->Contains(p); }))
      continue;
    ++exposed;
    sum += at;
  }
  const double open = side->outline ? scale * scale * side->outline->open_area : side->Area();
  side->exposed_area = cells.empty() ? open : open * exposed / static_cast<double>(cells.size());
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  if (exposed > 0 && exposed < static_cast<int>(cells.size())) {
    middle = sum / exposed;
  } else if (side->outline) {
    middle = scale * side->outline->open_centroid;
  }
  side->exposed_centroid = side->centre + middle.x() * side->axis_u + middle.y() * side->axis_v;
}

/// Cuts the side into strips along axis_v. Adds up the parts of each strip's middle line, kTouching
/// above the side, that other boxes leave. The strips end at the covering boxes' edges, so the sum
/// is exact for boxes parallel to the side. For others, strips are kTiltedStrip wide.
void ComputeExposure(const std::vector<Box>& boxes, Side* side) {
  if (std::any_of(boxes.begin(), boxes.end(), [](const Box& box) { return box.mesh != nullptr; }))
    return ComputeExposureByGrid(boxes, side);
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

/// A side of a part in its own frame, of a mesh not scaled. `index`: among the part's sides.
Facet FacetOf(const Box& box, int index) {
  if (box.mesh) return box.mesh->facets()[static_cast<std::size_t>(index)];
  const int axis = index / 2;
  const bool positive = index % 2 == 0;
  const auto unit = [axis](int k) { return Eigen::Vector3d::Unit((axis + k) % 3); };
  Facet face;
  face.labelled = kFaces.at(static_cast<std::size_t>(index)) != Face::kDown;
  face.normal = positive ? unit(0) : Eigen::Vector3d(-unit(0));
  face.axis_u = unit(positive ? 1 : 2);
  face.axis_v = unit(positive ? 2 : 1);
  face.half_u = box.size.dot(face.axis_u) / 2;
  face.half_v = box.size.dot(face.axis_v) / 2;
  face.centre = face.normal * (box.size[axis] / 2);
  return face;
}

/// `index`: of the side among its box's.
Side MakeSide(const std::vector<Box>& boxes, int box_index, int index) {
  const Box& box = boxes[static_cast<std::size_t>(box_index)];
  const Facet facet = FacetOf(box, index);
  const Eigen::Matrix3d& r = box.structure_from_box.linear();
  const double scale = box.mesh ? box.MeshScale() : 1;
  Side side;
  side.name = fmt::format(
      "{}/{}", box.name, box.mesh ? std::to_string(index + 1) : ToString(static_cast<Face>(index)));
  side.box = box_index;
  side.index = index;
  side.normal = r * facet.normal;
  side.axis_u = r * facet.axis_u;
  side.axis_v = r * facet.axis_v;
  side.half_u = scale * facet.half_u;
  side.half_v = scale * facet.half_v;
  side.centre = box.structure_from_box * Eigen::Vector3d(scale * facet.centre);
  side.outline = facet.outline;
  side.outline_scale = scale;
  return side;
}

}  // namespace

Box Box::FromMinMax(std::string name, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
  Box box;
  box.name = std::move(name);
  box.size = max - min;
  box.structure_from_box.translation() = (min + max) / 2;
  return box;
}

Box Box::FromMesh(std::string name, std::shared_ptr<const PartMesh> mesh) {
  Box box;
  box.name = std::move(name);
  box.size = mesh->size();
  box.structure_from_box.translation() = mesh->middle();
  box.mesh = std::move(mesh);
  return box;
}

bool Box::Contains(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d local = structure_from_box.inverse() * p;
  if ((local.cwiseAbs().array() > size.array() / 2).any()) return false;
  return !mesh || mesh->Contains(local / MeshScale());
}

std::array<Eigen::Vector3d, 8> Box::Corners() const {
  std::array<Eigen::Vector3d, 8> corners;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Eigen::Vector3d sign(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
    corners[k] = structure_from_box * Eigen::Vector3d(sign.cwiseProduct(size) / 2);
  }
  return corners;
}

std::vector<Eigen::Vector3d> Box::Vertices() const {
  const auto corners = Corners();
  if (!mesh) return {corners.begin(), corners.end()};
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3d& p : mesh->vertices())
    vertices.emplace_back(structure_from_box * Eigen::Vector3d(MeshScale() * p));
  return vertices;
}

std::vector<std::vector<std::array<Eigen::Vector3d, 3>>> Box::TrianglesBySide() const {
  const std::vector<Eigen::Vector3d> vertices = Vertices();
  std::vector<std::vector<std::array<Eigen::Vector3d, 3>>> sides(mesh->facets().size());
  for (std::size_t i = 0; i < mesh->triangles().size(); ++i) {
    auto& corners =
        sides[static_cast<std::size_t>(mesh->FacetOf(static_cast<int>(i)))].emplace_back();
    for (std::size_t k = 0; k < 3; ++k)
      corners[k] = vertices[static_cast<std::size_t>(mesh->triangles()[i][k])];
  }
  return sides;
}

double Side::BulgeAt(const Eigen::Vector3d& p) const {
  const auto rise = [&](const Eigen::Vector3d& axis, double half) {
    return std::cos(M_PI_2 * std::clamp(axis.dot(p - centre) / half, -1.0, 1.0));
  };
  return rise(axis_u, half_u) * rise(axis_v, half_v);
}

Eigen::Vector3d Side::ClosestPoint(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d d = p - centre;
  Eigen::Vector2d at(d.dot(axis_u), d.dot(axis_v));
  if (outline) {
    at = outline_scale * outline->ClosestPoint(at / outline_scale);
  } else {
    at = {std::clamp(at.x(), -half_u, half_u), std::clamp(at.y(), -half_v, half_v)};
  }
  return centre + at.x() * axis_u + at.y() * axis_v;
}

double Side::Area() const {
  return outline ? outline_scale * outline_scale * outline->area : 4 * half_u * half_v;
}

Eigen::Vector3d Side::Middle() const {
  if (!outline) return centre;
  const Eigen::Vector2d at = outline_scale * outline->centroid;
  return centre + at.x() * axis_u + at.y() * axis_v;
}

Border Side::BorderAt(int i) const {
  if (!outline) {
    const double sign = i % 2 == 0 ? 1 : -1, extent = i < 2 ? half_u : half_v;
    const Eigen::Vector3d outward = sign * (i < 2 ? axis_u : axis_v);
    return {outward, extent, centre + extent * outward, 2 * (i < 2 ? half_v : half_u)};
  }
  const Outline::Border& border = outline->borders[static_cast<std::size_t>(i)];
  const Eigen::Vector2d middle = outline_scale * (border.from + border.to) / 2;
  return {border.outward.x() * axis_u + border.outward.y() * axis_v, border.outward.dot(middle),
          centre + middle.x() * axis_u + middle.y() * axis_v,
          outline_scale * (border.to - border.from).norm()};
}

double Side::Beyond(const Eigen::Vector3d& p, int* border) const {
  const Eigen::Vector3d local = p - centre;
  const Eigen::Vector2d at(local.dot(axis_u), local.dot(axis_v));
  if (!outline) {
    const double beyond_u = std::abs(at.x()) - half_u, beyond_v = std::abs(at.y()) - half_v;
    if (border) *border = beyond_u > beyond_v ? (at.x() > 0 ? 0 : 1) : (at.y() > 0 ? 2 : 3);
    return std::max(beyond_u, beyond_v);
  }
  const Eigen::Vector2d q = at / outline_scale;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < outline->borders.size(); ++i) {
    const Outline::Border& of = outline->borders[i];
    const Eigen::Vector2d along = of.to - of.from;
    const double share = std::clamp(along.dot(q - of.from) / along.squaredNorm(), 0.0, 1.0);
    const double distance = (of.from + share * along - q).norm();
    if (distance >= least) continue;
    least = distance;
    if (border) *border = static_cast<int>(i);
  }
  return outline_scale * (outline->Contains(q) ? -least : least);
}

bool Structure::IsOfBoxes() const {
  return std::none_of(boxes_.begin(), boxes_.end(),
                      [](const Box& box) { return box.mesh != nullptr; });
}

std::string Structure::CountedParts() const {
  const char* one = IsOfBoxes() ? "box" : "part";
  const char* many = IsOfBoxes() ? "boxes" : "parts";
  return fmt::format("{} {}", boxes_.size(), boxes_.size() == 1 ? one : many);
}

bool Structure::Contains(const Eigen::Vector3d& p) const {
  return std::any_of(boxes_.begin(), boxes_.end(), [&](const Box& box) { return box.Contains(p); });
}

Structure Structure::FromBoxes(std::string name, std::vector<Box> boxes,
                               const std::vector<std::string>& label_order) {
  if (boxes.empty()) throw DataError("a structure needs at least one box or mesh");
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
    if (!mm.allFinite() || (!box.mesh && mm.minCoeff() < kShortestEdge * 1e3) ||
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
    const Box& box = structure.boxes_[static_cast<std::size_t>(b)];
    for (int i = 0; i < box.CountSides(); ++i) {
      Side side = MakeSide(structure.boxes_, b, i);
      ComputeExposure(structure.boxes_, &side);
      structure.sides_.push_back(std::move(side));
    }
  }

  std::map<std::string, int> index_of;
  std::vector<std::string> order = label_order;
  for (int i = 0; i < static_cast<int>(structure.sides_.size()); ++i) {
    const Side& side = structure.sides_[static_cast<std::size_t>(i)];
    if (!FacetOf(structure.boxes_[static_cast<std::size_t>(side.box)], side.index).labelled)
      continue;
    index_of[side.name] = i;
    if (label_order.empty()) order.push_back(side.name);
  }
  if (order.size() > kMaxLabels) {
    throw DataError(fmt::format("{} sides with labels violate sides <= {}: simplify the mesh",
                                order.size(), kMaxLabels));
  }
  structure.side_of_label_.assign(1, -1);
  for (const std::string& side_name : order) {
    const auto found = index_of.find(side_name);
    if (found == index_of.end()) {
      throw DataError(fmt::format(
          "label {} names the side '{}', which does not exist, has no label, or is listed twice",
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
  if (structure.num_classes_ == 1) {
    throw DataError(
        fmt::format("no side is flat and large enough: {:g} cm2, {:g} cm wide, and not facing down",
                    1e4 * kLeastFacetArea, 1e2 * kLeastFacetWidth));
  }
  return structure;
}

const Side& Structure::SideOfLabel(int label) const {
  if (label < 1 || label >= num_classes_) {
    throw Error(fmt::format("label {} violates 1 <= label < {}", label, num_classes_));
  }
  return sides_[static_cast<std::size_t>(side_of_label_[static_cast<std::size_t>(label)])];
}

Eigen::Vector3d Structure::Keypoint(int label, KeypointKind kind) const {
  const Side& side = SideOfLabel(label);
  return kind == KeypointKind::kCentre ? side.Middle() : side.exposed_centroid;
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
    if (!box.mesh) continue;
    for (const Eigen::Vector3d& p : box.mesh->vertices())
      for (const double x : p) text += fmt::format("{} ", std::llround(x * 1e6));
    for (const PartMesh::Triangle& triangle : box.mesh->triangles())
      text += fmt::format("{} ", fmt::join(triangle, " "));
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
    side = MakeSide(moved.boxes_, side.box, side.index);
    side.label = label;
    side.exposed_area = kNan;
    side.exposed_centroid.setConstant(kNan);
  }
  return moved;
}

namespace {

constexpr double kMillimetre = 1e-3;

/// Millimetres to 1 nm.
double Rounded(double mm) { return std::round(mm * 1e6) / 1e6; }

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
  struct MeshEntry {
    std::string name, file;
    MeshUnits units;
    std::vector<double> vertices;
    std::vector<int> triangles;
    template <class Archive>
    void Describe(Archive& ar) {
      ar("name", name, "of the part; of several parts, before the names of their nodes");
      ar("file", file, "glTF, OBJ, STL or PLY, relative to this file");
      ar("scale", units.scale, "metres per unit of the file", Above(0));
      ar("up", units.up, "the axis of the file that points up");
      ar("vertices", vertices, "in place of a file: x, y, z of each, mm");
      ar("triangles", triangles, "three vertices each, from 0, anticlockwise from outside");
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
  std::vector<MeshEntry> meshes;
  Sides sides;
  std::vector<LabelEntry> labels;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "of the structure");
    ar("boxes", boxes, "a list of {name, x, y, z}");
    ar("meshes", meshes, "a list of {file} or {name, vertices, triangles}");
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

/// `of`: the structure's file; a mesh stands beside it, or is it.
void AppendMesh(const StructureFile::MeshEntry& entry, const std::filesystem::path& of,
                std::vector<Box>* boxes) {
  if (!entry.file.empty()) {
    if (!entry.vertices.empty() || !entry.triangles.empty())
      throw DataError(fmt::format("mesh '{}' has both a file and vertices", Shortened(entry.file)));
    std::filesystem::path file = of.parent_path() / entry.file;
    if (!std::filesystem::exists(file)) file = FindInputFile(entry.file);
    try {
      std::vector<Box> parts = ReadMeshParts(file, entry.units);
      for (Box& part : parts) {
        if (!entry.name.empty())
          part.name = parts.size() == 1 ? entry.name : entry.name + "_" + part.name;
        boxes->push_back(std::move(part));
      }
    } catch (const DataError& e) {
      if (file == of) throw;
      throw DataError(fmt::format("mesh '{}': {}", Shortened(entry.file), e.what()));
    }
    return;
  }
  std::vector<double> metres = entry.vertices;
  for (double& x : metres) x *= kMillimetre;
  try {
    boxes->push_back(Box::FromMesh(entry.name, PartMesh::Make(metres, entry.triangles)));
  } catch (const DataError& e) {
    throw DataError(fmt::format("mesh '{}': {}", Shortened(entry.name), e.what()));
  }
}

StructureFile::MeshEntry EntryOf(const Box& box) {
  StructureFile::MeshEntry entry;
  entry.name = box.name;
  for (const Eigen::Vector3d& p : box.Vertices())
    for (const double x : p) entry.vertices.push_back(Rounded(x / kMillimetre));
  for (const PartMesh::Triangle& triangle : box.mesh->triangles())
    entry.triangles.insert(entry.triangles.end(), triangle.begin(), triangle.end());
  return entry;
}

}  // namespace

Structure ReadStructure(const std::filesystem::path& file_path, const MeshUnits& units) {
  const std::string path = file_path.string(), ending = file_path.extension().string();
  const bool is_mesh = IsMeshFile(file_path);
  if (!is_mesh && ending != ".yaml" && ending != ".yml")
    throw ConfigError(fmt::format("{}: a structure is a .yaml file or a mesh", path));
  if (!is_mesh && (units.scale != 1 || units.up != MeshUp::kFormat))
    throw ConfigError(
        fmt::format("{}: a scale and an axis are for a mesh; a .yaml has millimetres, y up", path));
  const std::filesystem::path found = FindInputFile(path);
  StructureFile file;
  file.name = file_path.stem().string();
  ConfigSource source;
  if (is_mesh) {
    file.meshes.push_back({"", found.filename().string(), units, {}, {}});
  } else {
    source = ConfigSource::FromString(ReadFile(found, kMaxTextBytes), path);
    file = ReadConfig(source, file);
  }
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
    for (const StructureFile::MeshEntry& entry : file.meshes) AppendMesh(entry, found, &boxes);
    Structure structure = Structure::FromBoxes(file.name, std::move(boxes), order);
    RequireStack(structure);
    return structure;
  } catch (const DataError& e) {
    throw ConfigError(fmt::format("{}: {}", ShownPath(path), e.what()));
  }
}

std::string StructureYaml(const Structure& structure) {
  StructureFile file;
  file.name = structure.name();
  for (const Box& box : structure.boxes()) {
    if (box.mesh) {
      file.meshes.push_back(EntryOf(box));
      continue;
    }
    const Eigen::Matrix3d r = box.structure_from_box.linear();
    if (r(1, 1) < 1 - 1e-9) {
      throw DataError(fmt::format("box '{}' leans; the boxes of a structure file stand upright",
                                  Shortened(box.name)));
    }
    StructureFile::BoxEntry& entry = file.boxes.emplace_back();
    entry.name = box.name;
    entry.yaw_deg = Rounded(std::atan2(r(0, 2), r(2, 2)) * 180 / M_PI);
    const Eigen::Vector3d middle = box.structure_from_box.translation();
    const Eigen::Vector3d low = (middle - box.size / 2) / kMillimetre,
                          high = (middle + box.size / 2) / kMillimetre;
    entry.x = {Rounded(low.x()), Rounded(high.x())};
    entry.y = {Rounded(low.y()), Rounded(high.y())};
    entry.z = {Rounded(low.z()), Rounded(high.z())};
  }
  for (const std::string& side : structure.SideNames())
    file.labels.push_back({static_cast<int>(file.labels.size()) + 1, side});
  return WriteConfig(file);
}

}  // namespace volalign
