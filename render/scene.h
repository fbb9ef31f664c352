#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/sample_config.h"
#include "render/scene_mesh.h"

namespace volalign {

/// The structure as somebody built it.
struct AssembledStructure {
  Structure structure;            ///< Structure::DisplacedToDraw
  std::vector<Pose> box_offsets;  ///< structure_from_structure of each box (Structure::Displaced)
  double size_scale = 1;
  /// Turn of everything but the structure about the point of the floor below the origin.
  Pose structure_from_room = Pose::Identity();
};

/// Draws the placement and size errors and the floor's tilt of `config` (random stages "assembly"
/// and "floor"). Boxes stay on the floor and on one another. `size_scale`: that of boxes which have
/// been drawn before and are built up again.
AssembledStructure Assemble(const Structure& nominal, const AssemblyConfig& config,
                            std::uint64_t seed, std::uint64_t index,
                            std::optional<double> size_scale = std::nullopt);

/// The structure where it stands at another time.
struct StructureElsewhere {
  Pose structure_from_elsewhere = Pose::Identity();  ///< of its nominal frame there
  Structure structure;
};

struct SceneOptions {
  bool structure_present = true;
  double room_probability = 1;  ///< of floor, walls and what is on them; 0 or 1 decide it
  Pose structure_from_room = Pose::Identity();  ///< AssembledStructure's
  /// Sensors that nothing may stand near to, and whose view of the structure stays free but for
  /// occluders, which go before the first one.
  std::vector<Pose> structure_from_sensors;
  /// Not drawn, but its places and the sensors' views of them stay free as the structure's own.
  std::vector<StructureElsewhere> elsewhere;
};

/// A mesh of the structure in a procedural room: floor at its lowest point, four walls, perhaps a
/// ceiling, furniture, people, tripods, boxes that are not the structure, occluders. A pure
/// function of its arguments; each kind of object has a random stage of its own ("room", "clutter",
/// "tripods", "distractors", "occluder").
SceneMesh BuildScene(const SceneConfig& config, const Structure& structure,
                     const SceneOptions& options, std::uint64_t seed, std::uint64_t index);

/// The same scene when the structure has moved: `scene` in the structure's new frame, with
/// `structure` in place of its own (no structure where it has none).
SceneMesh MoveStructure(const SceneMesh& scene, const Structure& structure,
                        const Pose& new_from_scene);

/// Whether one of the boxes stands where a sensor's tripod does, or nearer than `gap` m to it.
bool StandsInTripod(const StructureElsewhere& elsewhere, const Pose& structure_from_sensor,
                    double gap = 0);

/// A depth sensor on a tripod that stands on the floor; `structure_from_sensor` is its pose.
void AppendTripod(const Pose& structure_from_sensor, double floor_height, SceneMesh* mesh);

}  // namespace volalign
