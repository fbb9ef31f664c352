#pragma once

#include <cstddef>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/symmetries.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A view in one orientation, with the network's labels and the pose that follows from them.
struct Labelling : LabelledPose {
  std::size_t view = 0;
  int turns = 0;
  /// Is the pose beyond doubt? Labels and depths then fit the structure, and it stands on a floor
  /// (FloorMargin). Upside down, or shifted by a box, it would not.
  bool settled = false;
};

/// A pose that a sensor may have, with its evidence: natural logarithms of the odds that the pose
/// is right rather than wrong (infer/depth/share_odds.h).
struct Hypothesis {
  Pose structure_from_sensor = Pose::Identity();
  PoseSource source = PoseSource::kNetwork;
  std::size_t labelling = 0;  ///< index of its labelling, if it is the network's
  int symmetry = -1;          ///< index of the symmetry that moved the labelling's pose; -1: none
  int turns = 0;  ///< into the network's orientation; 0 also where they are given or not known
  double by_depth = 0;
  double by_floor = 0;
  /// By the unchanged labels, and their outline, of the labelling that speaks for the pose most.
  double by_labels = 0, by_outline = 0;
};

/// The poses that a sensor may have, with their evidence. They are the poses of the labellings,
/// their symmetric ones, and those of FindPosesByGeometry where the method uses geometry. With
/// `known_up`, the labellings' orientation is given. Symmetries that turn the structure over are
/// then left out, as are geometry's poses that turn it over against all of the labellings'.
std::vector<Hypothesis> FindHypotheses(const SensorView& view, const Structure& structure,
                                       const std::vector<StructureSymmetry>& symmetries,
                                       const std::vector<const Labelling*>& labellings,
                                       bool known_up, PoseMethod method);

/// Sets the evidence of each hypothesis. If the labels' outline speaks for none of them, labels do
/// not count. Beyond the distances that it was trained for, a network labels the room.
void WeighHypotheses(const SensorView& view, const Structure& structure,
                     const std::vector<const Labelling*>& labellings,
                     std::vector<Hypothesis>* hypotheses);

/// The labels that a pose implies, and the initial pose that follows from them. They take the place
/// of a network's labels.
LabelledPose LabelByPose(const SensorView& view, const Structure& structure, Pose pose);

}  // namespace volalign
