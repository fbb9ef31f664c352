#pragma once

#include <cstddef>
#include <vector>

#include "core/config/config_word.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What the network says about a frame in one orientation, and the pose that follows. What it
/// refers to must outlive the choice.
struct PoseTrial {
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;
};

/// What an initial pose comes from: the network's labels, the structure's geometry, or the other
/// sensors.
enum class PoseSource { kNetwork, kGeometry, kNeighbours };
constexpr Words<PoseSource, 3> WordsOf(PoseSource) {
  return {{{"network", PoseSource::kNetwork},
           {"geometry", PoseSource::kGeometry},
           {"neighbours", PoseSource::kNeighbours}}};
}

/// A pose that competes, and what speaks for it: natural logarithms of the odds that a pose is
/// right rather than wrong (infer/depth/share_odds.h).
struct PoseCandidate {
  Pose structure_from_sensor = Pose::Identity();
  PoseSource source = PoseSource::kNetwork;
  std::size_t trial = 0;  ///< index of the trial that it comes from, if it is the network's
  int alias = -1;         ///< index of the alias that moved the trial's pose; -1: none
  double by_depth = 0;
  double by_floor = 0;
  /// By the labels, as they are, of the trial in which they speak for it most, and their outline.
  double by_labels = 0, by_outline = 0;
  double by_own_labels = 0;  ///< by its trial's labels, renamed by the alias
};

/// The same rig otherwise: a pose that a sensor has in another set of the rig's poses.
struct PoseAlternative {
  int rig = 0;  ///< which set; sensors that have another pose in one set share the choice
  /// 2 for the sensor's most probable other pose, 3 for the next; of another set with that pose,
  /// the same.
  int number = 2;
  double log_odds = 0;  ///< natural logarithm, of the chosen set against that one
  Pose structure_from_sensor = Pose::Identity();
};

struct PoseChoice {
  bool found = false;
  /// Of the poses that are about the one chosen, that with the best by_own_labels: its trial and
  /// alias say which labels suit the pose.
  PoseCandidate best;
  /// Another pose for which about as much speaks.
  bool ambiguous = false;
  PoseCandidate rival;
  /// Upside down it would be as good, but then contradict the other sensors of the rig, or it
  /// contradicts them now.
  bool up_unknown = false;
  bool given = false;  ///< a person has chosen the pose, see SensorCandidates::chosen
  std::vector<PoseAlternative> alternatives;  ///< the most probable first
};

/// Does one of two poses of a sensor turn the structure over?
bool TurnsOver(const Pose& from, const Pose& to);

/// The poses of the trials, and of their aliases, each estimated again with the labels that it
/// implies. With `known_up`, the trials' orientation is given, and poses that turn the structure
/// over are left out.
std::vector<PoseCandidate> PosesOfTrials(const SensorView& view, const Structure& structure,
                                         const std::vector<StructureAlias>& aliases,
                                         const std::vector<PoseTrial>& trials, bool known_up,
                                         const InitialPoseOptions& initial);

/// Sets what speaks for each of the poses that compete for a view. Labels whose outline speaks for
/// none of them say nothing: beyond the distances that it was trained for, a network labels the
/// room.
void WeighPoses(const SensorView& view, const Structure& structure,
                const std::vector<StructureAlias>& aliases, const std::vector<PoseTrial>& trials,
                const InitialPoseOptions& initial, std::vector<PoseCandidate>* poses);

}  // namespace volalign
