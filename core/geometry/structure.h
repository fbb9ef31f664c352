#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/config/config_word.h"
#include "core/geometry/part_mesh.h"
#include "core/geometry/pose.h"

namespace volalign {

/// Faces of a box by outward normal in its own frame (configs/structure.yaml).
enum class Face { kFront, kBack, kUp, kDown, kRight, kLeft };  // +x -x +y -y +z -z
inline constexpr std::array<Face, 6> kFaces = {Face::kFront, Face::kBack,  Face::kUp,
                                               Face::kDown,  Face::kRight, Face::kLeft};
constexpr Words<Face, 6> WordsOf(Face) {
  return {{{"front", Face::kFront},
           {"back", Face::kBack},
           {"up", Face::kUp},
           {"down", Face::kDown},
           {"right", Face::kRight},
           {"left", Face::kLeft}}};
}

/// Labels are uint8; a box has 5.
inline constexpr int kMaxLabels = 255, kMaxBoxes = kMaxLabels / 5;
/// Limits of a described box's edges, m. Values beyond them are in other units.
inline constexpr double kShortestEdge = 0.01, kLongestEdge = 100;

/// A solid, rigid part of a structure: a box of `size` along its own axes, m, or a mesh within such
/// a box. The box's centre is the origin of its frame, at structure_from_box in the structure
/// frame.
struct Box {
  std::string name;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  Pose structure_from_box = Pose::Identity();
  std::shared_ptr<const PartMesh> mesh = nullptr;  ///< null: the whole box

  static Box FromMinMax(std::string name, const Eigen::Vector3d& min, const Eigen::Vector3d& max);
  /// Where the mesh's vertices were given.
  static Box FromMesh(std::string name, std::shared_ptr<const PartMesh> mesh);

  /// Corners in the structure frame.
  std::array<Eigen::Vector3d, 8> Corners() const;
  /// Corners, or the vertices of the mesh, in the structure frame.
  std::vector<Eigen::Vector3d> Vertices() const;
  /// The triangles of a mesh by side, in the structure frame, anticlockwise from outside.
  std::vector<std::vector<std::array<Eigen::Vector3d, 3>>> TrianglesBySide() const;
  /// How much larger the part is than its mesh.
  double MeshScale() const { return size.x() / mesh->size().x(); }
  /// Is p, in the structure frame, inside?
  bool Contains(const Eigen::Vector3d& p) const;
  /// Number of its sides.
  int CountSides() const { return mesh ? static_cast<int>(mesh->facets().size()) : 6; }
};

/// A straight piece of a side's border: outward . (p - centre of the side) = extent.
struct Border {
  Eigen::Vector3d outward;  ///< unit, in the side's plane
  double extent = 0;        ///< m
  Eigen::Vector3d middle;
  double length = 0;  ///< m
};

/// A side of a part, in the structure frame, metres: of a box, a rectangle; of a mesh, a facet.
struct Side {
  std::string name;                        ///< "top/front", "shelf/3"
  int box = 0;                             ///< index into Structure::boxes()
  int index = 0;                           ///< among the part's sides
  std::uint8_t label = 0;                  ///< 0: solid but background, as every `down` side is
  Eigen::Vector3d centre;                  ///< of the rectangle around it
  Eigen::Vector3d normal;                  ///< outward, unit
  Eigen::Vector3d axis_u, axis_v;          ///< unit, in the plane; axis_u x axis_v = normal
  double half_u = 0, half_v = 0;           ///< half extents along them
  std::shared_ptr<const Outline> outline;  ///< within the rectangle; null: all of it
  double outline_scale = 1;
  double exposed_area = 0;           ///< m^2 not covered by another box
  Eigen::Vector3d exposed_centroid;  ///< of that area; the centre if nothing is exposed

  Face face() const { return kFaces.at(static_cast<std::size_t>(index)); }  ///< of a box's side
  /// Closest point of the finite side to p.
  Eigen::Vector3d ClosestPoint(const Eigen::Vector3d& p) const;
  double Area() const;  ///< m^2
  /// The point that its symmetries leave where it is: the centre of area.
  Eigen::Vector3d Middle() const;
  /// Along its border as seen from outside. A rectangle's are at +u, -u, +v and -v.
  int CountBorders() const { return outline ? static_cast<int>(outline->borders.size()) : 4; }
  Border BorderAt(int i) const;
  /// Distance of a point of the side's plane beyond its border, m; negative within it. `border`:
  /// the one that it lies farthest beyond, or nearest to.
  double Beyond(const Eigen::Vector3d& p, int* border = nullptr) const;
  /// Displacement of the side at its point p, as a share of the bulge in its middle: half a sine
  /// along both edges.
  double BulgeAt(const Eigen::Vector3d& p) const;
};

/// The point that represents a side: its Middle (the paper), or its exposed part's centroid.
enum class KeypointKind { kCentre, kExposed };
constexpr Words<KeypointKind, 2> WordsOf(KeypointKind) {
  return {{{"centre", KeypointKind::kCentre}, {"exposed", KeypointKind::kExposed}}};
}

/// A stack of boxes or other parts with labelled sides. Immutable after construction; cheap to
/// copy.
class Structure {
 public:
  Structure() = default;

  /// `label_order` lists side names in the order of their ids 1, 2, .... If it is empty, sides are
  /// numbered box by box in the order front, back, up, right, left. Throws DataError for duplicate
  /// or empty names, for names that RequirePlainName refuses, and for more than kMaxBoxes boxes. It
  /// throws the same for boxes more than 1 km away or with an edge outside of kShortestEdge to
  /// kLongestEdge. A label order has to name every side that has a label once.
  static Structure FromBoxes(std::string name, std::vector<Box> boxes,
                             const std::vector<std::string>& label_order = {});

  const std::string& name() const { return name_; }
  const std::vector<Box>& boxes() const { return boxes_; }
  /// Are all parts boxes?
  bool IsOfBoxes() const;
  /// "4 boxes", "1 part".
  std::string CountedParts() const;
  bool Contains(const Eigen::Vector3d& p) const;  ///< Is p inside of a part?
  /// All sides of every part. A box has 6, in the order of kFaces.
  const std::vector<Side>& sides() const { return sides_; }
  /// The side of a label in [1, num_classes). Throws Error for others.
  const Side& SideOfLabel(int label) const;
  /// Number of labels including background (21 for the paper's structure).
  int num_classes() const { return num_classes_; }
  Eigen::Vector3d Keypoint(int label, KeypointKind kind) const;
  /// Lowest y: the floor.
  double FloorHeight() const;
  /// Height between the floor and the highest point, m.
  double Height() const;
  /// SHA-256 over names, sizes, poses, vertices (to 1 um), triangles and labels: it identifies
  /// dimensions and topology.
  std::string Hash() const;
  /// The names of all labels in order. Structures with equal topologies have equal side names.
  std::vector<std::string> SideNames() const;

  /// The same boxes and labels, each box moved: structure_from_box' = T_b * structure_from_box, and
  /// scaled by `size_scale` about its own centre. Throws Error unless offsets.size() ==
  /// boxes().size().
  Structure Displaced(const std::vector<Pose>& offsets, double size_scale = 1.0) const;
  /// Displaced, but the exposed parts of its sides are NaN, for drawing only. To find these parts
  /// takes twice as long as the rest of a training sample's scene.
  Structure DisplacedToDraw(const std::vector<Pose>& offsets, double size_scale) const;

 private:
  std::string name_;
  std::vector<Box> boxes_;
  std::vector<Side> sides_;
  std::vector<int> side_of_label_;  // index into sides_, [0] unused
  int num_classes_ = 1;
};

/// Which axis of a mesh points up. `format`: as the format has it, y in glTF and OBJ, z in STL and
/// PLY.
enum class MeshUp { kFormat, kX, kY, kZ };
constexpr Words<MeshUp, 4> WordsOf(MeshUp) {
  return {{{"format", MeshUp::kFormat}, {"x", MeshUp::kX}, {"y", MeshUp::kY}, {"z", MeshUp::kZ}}};
}
/// How a mesh is read. `scale`: metres per unit; glTF has metres.
struct MeshUnits {
  double scale = 1;
  MeshUp up = MeshUp::kFormat;
};

/// Reads a structure: a .yaml of boxes or meshes (configs/structure.yaml), lengths in millimetres,
/// or a mesh (mesh_file.h). A box has x, y, z as [min, max] and optionally `yaw_deg` about the
/// vertical through its centre. A mesh is a `file` or has `vertices` and `triangles`. `units`: of a
/// mesh. Throws IoError or ConfigError, also for a structure with an impossible StackFault
/// (stack_faults.h), and for other units of a .yaml.
Structure ReadStructure(const std::filesystem::path& path, const MeshUnits& units = {});

/// The text that ReadStructure reads as the same structure, to 1 nm. Throws DataError for a tilted
/// box.
std::string StructureYaml(const Structure& structure);

}  // namespace volalign
