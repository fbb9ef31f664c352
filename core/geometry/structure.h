#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/config/config_word.h"
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
Eigen::Vector3d FaceNormal(Face face);

/// Boxes cover each other if their gap, m, is smaller.
inline constexpr double kTouching = 1e-3;

/// Labels are uint8, 5 per box.
inline constexpr int kMaxBoxes = 51;
/// Limits of a described box's edges, m. Values beyond them are in other units.
inline constexpr double kShortestEdge = 0.01, kLongestEdge = 100;

/// A solid box: `size` along its own axes, m. The centre is the origin of its frame, at
/// structure_from_box in the structure frame.
struct Box {
  std::string name;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  Pose structure_from_box = Pose::Identity();

  static Box FromMinMax(std::string name, const Eigen::Vector3d& min, const Eigen::Vector3d& max);

  /// Corners in the structure frame.
  std::array<Eigen::Vector3d, 8> Corners() const;
};

/// One rectangular side of a box, in the structure frame, metres.
struct Side {
  std::string name;  ///< "top/front"
  int box = 0;       ///< index into Structure::boxes()
  Face face = Face::kFront;
  std::uint8_t label = 0;  ///< 0 for every `down` side, which is solid but background
  Eigen::Vector3d centre;
  Eigen::Vector3d normal;            ///< outward, unit
  Eigen::Vector3d axis_u, axis_v;    ///< unit, in the plane; axis_u x axis_v = normal
  double half_u = 0, half_v = 0;     ///< half extents along them
  double exposed_area = 0;           ///< m^2 not covered by another box
  Eigen::Vector3d exposed_centroid;  ///< of that area; the centre if nothing is exposed

  /// Closest point of the finite rectangle to p.
  Eigen::Vector3d ClosestPoint(const Eigen::Vector3d& p) const;
  /// Displacement of the side at its point p, as a share of the bulge in its middle: half a sine
  /// along both edges.
  double BulgeAt(const Eigen::Vector3d& p) const;
};

/// The point that represents a side: its centre (the paper), or its exposed part's centroid.
enum class KeypointKind { kCentre, kExposed };
constexpr Words<KeypointKind, 2> WordsOf(KeypointKind) {
  return {{{"centre", KeypointKind::kCentre}, {"exposed", KeypointKind::kExposed}}};
}

/// A stack of boxes with labelled sides. Immutable after construction; cheap to copy.
class Structure {
 public:
  Structure() = default;

  /// `label_order` lists side names in the order of their ids 1, 2, .... If it is empty, sides are
  /// numbered box by box in the order front, back, up, right, left. Throws DataError for duplicate
  /// or empty names, for names that RequirePlainName refuses, and for more than kMaxBoxes boxes. It
  /// throws the same for boxes more than 1 km away or with an edge outside of kShortestEdge to
  /// kLongestEdge. A label order has to name every side but `down` once.
  static Structure FromBoxes(std::string name, std::vector<Box> boxes,
                             const std::vector<std::string>& label_order = {});

  const std::string& name() const { return name_; }
  const std::vector<Box>& boxes() const { return boxes_; }
  /// All 6 sides of every box, box by box in the order of kFaces.
  const std::vector<Side>& sides() const { return sides_; }
  /// The side of a label in [1, num_classes). Throws Error for others.
  const Side& SideOfLabel(int label) const;
  /// Number of labels including background (21 for the paper's structure).
  int num_classes() const { return num_classes_; }
  const Eigen::Vector3d& Keypoint(int label, KeypointKind kind) const;
  /// Lowest y: the floor.
  double FloorHeight() const;
  /// Height between the floor and the highest point, m.
  double Height() const;
  /// SHA-256 over names, sizes, poses (to 1 um) and labels: it identifies dimensions and topology.
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

/// Reads a .yaml of boxes (configs/structure.yaml): millimetres, `boxes`, optional `labels`,
/// `name`. A box has x, y, z as [min, max] and optionally `yaw_deg` about the vertical through its
/// centre. Throws IoError or ConfigError, also for a stack with an impossible StackFault
/// (stack_faults.h), and for a file of another ending.
Structure ReadStructure(const std::filesystem::path& path);

/// The text that ReadStructure reads as the same structure, to 1 nm. Throws DataError for a tilted
/// box.
std::string StructureYaml(const Structure& structure);

}  // namespace volalign
