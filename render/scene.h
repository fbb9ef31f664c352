#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/sample_config.h"
#include "render/scene_mesh.h"

namespace volalign {

/// The structure as built.
struct AssembledStructure {
  Structure structure;            ///< Structure::DisplacedToDraw
  std::vector<Pose> box_offsets;  ///< structure_from_structure of each box (Structure::Displaced)
  double size_scale = 1;
  /// Turn of everything except the structure, about the floor's point below the origin.
  Pose structure_from_room = Pose::Identity();
};

/// Draws the errors of placement and size and the floor's tilt by `config` (random stages
/// "assembly" and "floor"). Boxes stay on the floor and on one another. `size_scale`: of boxes that
/// were drawn before and are stacked again.
AssembledStructure Assemble(const Structure& nominal, const AssemblyConfig& config,
                            std::uint64_t seed, std::uint64_t index,
                            std::optional<double> size_scale = std::nullopt);

/// The structure at another time.
struct OtherPlacement {
  Pose structure_from_elsewhere = Pose::Identity();  ///< of its nominal frame there
  Structure structure;
};

struct SceneOptions {
  bool structure_present = true;
  double room_probability = 1;                  ///< of floor, walls and fixtures; 0 or 1: certain
  Pose structure_from_room = Pose::Identity();  ///< AssembledStructure's
  /// Sensors that stay clear of objects. Their view of the structure stays free, except for
  /// occluders before the first one.
  std::vector<Pose> structure_from_sensors;
  /// Not drawn, but its places and the sensors' views of them stay free like the structure's own.
  std::vector<OtherPlacement> elsewhere;
};

/// A mesh of the structure in a procedural room: floor at its lowest point, four walls, perhaps a
/// ceiling, furniture, people, tripods, boxes that are not the structure, occluders. A pure
/// function of its arguments. Each kind of object has its own random stage ("room", "clutter",
/// "tripods", "distractors", "occluder").
SceneMesh BuildScene(const SceneConfig& config, const Structure& structure,
                     const SceneOptions& options, std::uint64_t seed, std::uint64_t index);

/// The scene after the structure has moved: `scene` in the structure's new frame, with `structure`
/// instead of its own, if it has one.
SceneMesh MoveStructure(const SceneMesh& scene, const Structure& structure,
                        const Pose& new_from_scene);

/// Does one of the boxes stand in a sensor's tripod, or nearer than `gap` m to it?
bool StandsInTripod(const OtherPlacement& elsewhere, const Pose& structure_from_sensor,
                    double gap = 0);

/// A depth sensor on a tripod that stands on the floor; `structure_from_sensor` is its pose.
void AppendTripod(const Pose& structure_from_sensor, double floor_height, SceneMesh* mesh);

/// The side from which a board reaches into a sensor's view. Left and right boards are upright; the
/// one from below is low.
enum class BoardEdge { kLeft, kRight, kBelow };
inline constexpr int kBoardEdges = 3;

/// Appends a board that stands on the floor 0.7 m before a sensor. It hides a share, in (0, 1], of
/// the sensor's rays to the structure: those farthest to one side, or the lowest. Appends nothing
/// if the sensor does not see the structure. `rays`: the sensor's.
void AppendBoard(const Structure& structure, const RayTable& rays,
                 const Pose& structure_from_sensor, double share, BoardEdge edge, SceneMesh* mesh);

}  // namespace volalign
