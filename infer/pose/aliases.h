#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/pose.h"
#include "core/structure.h"
#include "infer/pose/initial_pose.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A motion that brings at least half of a structure's boxes onto boxes of the structure, to 2 cm.
/// The paper's stack has two kinds: half a turn about a horizontal diagonal (all boxes), and steps
/// of its spiral, a quarter turn and a box higher or lower (all but one). A view that leaves the
/// rest out cannot tell a pose from its alias by the structure's shape.
struct StructureAlias {
  Pose motion = Pose::Identity();         ///< of the structure, in its own frame
  std::vector<std::uint8_t> label_after;  ///< of a side after the motion, by its label; 0: of none
  int boxes = 0;                          ///< that come to lie on a box
  bool keeps_up() const { return motion.linear()(1, 1) > 0.9; }
};

/// Every one but the identity, those with the most boxes first.
std::vector<StructureAlias> FindAliases(const Structure& structure);

/// What the network says about a frame in one orientation, and the pose that follows.
struct PoseTrial {
  int turns = 0;
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;
};

/// What speaks for one pose.
struct PoseEvidence {
  Pose structure_from_sensor = Pose::Identity();
  std::size_t trial = 0;     ///< whose labels fit it best, taken over by an alias where they do so
  int alias = -1;            ///< index; -1: the labels as they are
  double label_score = 0;    ///< Agreement::score of those labels
  double network_score = 0;  ///< the best of all trials' labels, as they are
  double overlap = 0;        ///< MeasureOverlap, of the same trial
  double floor = 0;          ///< FloorEvidence::balance, as a share of the pixels looked at
};

struct PoseChoice {
  bool found = false;
  PoseEvidence best;
  /// Another pose that shape, floor and labels speak for about as much.
  bool ambiguous = false;
  PoseEvidence rival;
};

/// Chooses among the trials' poses and their aliases, each made anew with the labels that it
/// implies. The shape of what was seen decides first, whatever box it was taken for; then the
/// floor; then, where no floor does, the network's labels, which tell one step of a spiral from the
/// next but not up from down: a network that is shown a part of the structure upside down labels it
/// about as well. `known_up`: the trials' orientation is given, and poses that turn over what the
/// network takes for upright are out.
PoseChoice ChoosePose(const SensorView& view, const Structure& structure,
                      const std::vector<StructureAlias>& aliases,
                      const std::vector<PoseTrial>& trials, bool known_up,
                      const InitialPoseOptions& options);

/// By how much the floor speaks for a pose rather than for any alias of it that turns it over or
/// moves it: the least difference of FloorEvidence::balance as a share of the pixels looked at; 1
/// without aliases.
double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor);

/// A margin from which on the floor decides.
inline constexpr double kClearFloorMargin = 0.05;

/// The labels that the sides have after the motion.
SegmentationResult Relabelled(SegmentationResult segmentation, const StructureAlias& alias);

/// For a pose that shape and floor have settled: a pixel that does not lie within 5 cm of the side
/// that `segmentation` names takes the name, confidence with it, that one of `others` (the same
/// frame in other orientations) or an alias gives it, if it lies on that one. A network that sees a
/// part of the structure only takes some boxes for their neighbours.
void ReconcileLabels(const SensorView& view, const Structure& structure,
                     const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor,
                     const std::vector<const SegmentationResult*>& others, double min_confidence,
                     SegmentationResult* segmentation);

/// "upside down", "turned by 90 deg and 0.41 m higher".
std::string DescribeMotion(const Pose& from, const Pose& to);

}  // namespace volalign
