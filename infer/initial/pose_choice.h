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

/// The network's labels of a frame in one orientation, and the pose that follows. The referenced
/// values must outlive the choice.
struct PoseTrial {
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;
};

/// Source of an initial pose: the network's labels, the structure's geometry, the other sensors, or
/// a prior.
enum class PoseSource { kNetwork, kGeometry, kNeighbours, kPrior };
constexpr Words<PoseSource, 4> WordsOf(PoseSource) {
  return {{{"network", PoseSource::kNetwork},
           {"geometry", PoseSource::kGeometry},
           {"neighbours", PoseSource::kNeighbours},
           {"prior", PoseSource::kPrior}}};
}

/// A competing pose with its evidence: natural logarithms of the odds that the pose is right rather
/// than wrong (infer/depth/share_odds.h).
struct PoseCandidate {
  Pose structure_from_sensor = Pose::Identity();
  PoseSource source = PoseSource::kNetwork;
  std::size_t trial = 0;  ///< index of its trial, if it is the network's
  int alias = -1;         ///< index of the symmetry that moved the trial's pose; -1: none
  double by_depth = 0;
  double by_floor = 0;
  /// By the unchanged labels, and their outline, of the trial that speaks for the pose most.
  double by_labels = 0, by_outline = 0;
  double by_own_labels = 0;  ///< by its trial's labels, renamed by the symmetry
};

/// A pose that a sensor has in another set of the rig's poses.
struct PoseAlternative {
  int rig = 0;  ///< number of the set; sensors with another pose in one set share it
  /// 2 for the sensor's most probable other pose, 3 for the next. The same pose in another set has
  /// the same number.
  int number = 2;
  double log_odds = 0;  ///< natural logarithm, of the chosen set against that one
  Pose structure_from_sensor = Pose::Identity();
};

struct PoseChoice {
  bool found = false;
  /// The pose with the best by_own_labels among those about the chosen one. Its trial and symmetry
  /// say which labels suit the pose.
  PoseCandidate best;
  /// Another pose is about as probable.
  bool ambiguous = false;
  PoseCandidate rival;
  /// The sensor may be upside down or not, and one of both contradicts the other sensors.
  bool up_unknown = false;
  bool given = false;  ///< a person has chosen the pose, see SensorCandidates::chosen
  std::vector<PoseAlternative> alternatives;  ///< the most probable first
};

/// Does one of two poses of a sensor turn the structure over?
bool TurnsOver(const Pose& from, const Pose& to);

/// The poses of the trials and their symmetric poses, each estimated again with the labels that it
/// implies. With `known_up`, the trials' orientation is given, and poses that turn the structure
/// over are left out.
std::vector<PoseCandidate> PosesOfTrials(const SensorView& view, const Structure& structure,
                                         const std::vector<StructureAlias>& aliases,
                                         const std::vector<PoseTrial>& trials, bool known_up,
                                         const InitialPoseOptions& initial);

/// Sets the evidence of each competing pose. If the labels' outline speaks for none of them, labels
/// do not count. Beyond the distances that it was trained for, a network labels the room.
void WeighPoses(const SensorView& view, const Structure& structure,
                const std::vector<StructureAlias>& aliases, const std::vector<PoseTrial>& trials,
                std::vector<PoseCandidate>* poses);

}  // namespace volalign
