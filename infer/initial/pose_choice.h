#pragma once

#include <cstddef>
#include <vector>

#include "core/base/odds.h"
#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/alike.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// How poses of one frame are told from each other. Scores are Agreement::score, shapes are
/// ShapeIou::ratio, floors FloorFit::share.
struct PoseChoiceOptions {
  double rival_score = 0.5;
  double shape_iou_margin = 0.1;
  double floor_margin = kNotable;
  double score_margin = 0.2;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("rival_score", rival_score,
       "share of the best orientation's agreement with labels and depth that another one needs to "
       "compete with it",
       Between(0, 1));
    ar("shape_iou_margin", shape_iou_margin,
       "difference of intersections over union of what was seen and the structure from which on "
       "its shape decides between two poses; twice that before the poses are estimated again",
       Between(0, 1), FormerlyNamed("overlap_margin"));
    ar("floor_margin", floor_margin,
       "difference of the shares of pixels that lie on the floor, those under it counted twice "
       "against it, from which on the floor decides",
       Above(0));
    ar("score_margin", score_margin,
       "difference of agreements from which on the network's labels decide, though not about up "
       "and down",
       Above(0));
  }
};

/// What the network says about a frame in one orientation, and the pose that follows. What it
/// refers to must outlive the choice.
struct PoseTrial {
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;
};

/// What an initial pose comes from: the network's labels, the structure's geometry, or the other
/// sensors.
enum class PoseSource { kNetwork, kGeometry, kNeighbours };
const char* ToString(PoseSource source);  ///< "network", "geometry", "neighbours"
std::vector<PoseSource> AllOf(PoseSource);

/// A pose that competes, and what speaks for it.
struct PoseCandidate {
  Pose structure_from_sensor = Pose::Identity();
  PoseSource source = PoseSource::kNetwork;
  std::size_t trial = 0;     ///< index of the trial that it comes from, if it is the network's
  int alias = -1;            ///< index of the alias that moved the trial's pose; -1: none
  double shape_iou = 0;      ///< ShapeIou::ratio: how well the shape fits
  double floor = 0;          ///< FloorFit::share
  double label_score = 0;    ///< Agreement::score of the trial's labels, renamed by the alias
  double network_score = 0;  ///< the best Agreement::score of all trials' labels, as they are
};

/// The same rig otherwise: a pose that a sensor has in another set of the rig's poses.
struct PoseTwin {
  int rig = 0;  ///< which set; sensors that have another pose in one set share the choice
  /// 2 for the sensor's most probable other pose, 3 for the next; of another set with that pose,
  /// the same.
  int number = 2;
  double log_odds = 0;  ///< natural logarithm, of the chosen set against that one
  Pose structure_from_sensor = Pose::Identity();
};

struct PoseChoice {
  bool found = false;
  /// Of the poses that are about the one chosen, that with the best label_score: its trial and
  /// alias say which labels suit the pose. Its network_score is the best of all these.
  PoseCandidate best;
  /// Another pose that shape, floor and labels speak for about as much.
  bool ambiguous = false;
  PoseCandidate rival;
  /// Upside down it would be as good, but then contradict the other sensors of the rig, or it
  /// contradicts them now.
  bool up_unknown = false;
  bool given = false;           ///< a person has chosen the pose, see SensorCandidates::twin
  std::vector<PoseTwin> twins;  ///< where poses were chosen for the rig, the most probable first
};

/// The poses that compete for a view, judged: the trials' and those of their aliases, each
/// estimated again with the labels that it implies. The shape of what was seen decides first,
/// whatever the labels say: poses of which it speaks for another are left out; the others are in
/// the order of their shape_iou, the best first. With `known_up`, the trials' orientation is given,
/// and poses that turn the structure over are left out.
std::vector<PoseCandidate> FindCompetitors(const SensorView& view, const Structure& structure,
                                           const std::vector<StructureAlias>& aliases,
                                           const std::vector<PoseTrial>& trials, bool known_up,
                                           const InitialPoseOptions& initial,
                                           const PoseChoiceOptions& options);

/// Does one of two poses of a sensor turn the structure over?
bool TurnsOver(const Pose& from, const Pose& to);

/// The poses of the trials, and of their aliases, that compete: of every trial whose agreement is
/// at least options.rival_score of the best one's.
std::vector<PoseCandidate> ListCompetitors(const std::vector<PoseTrial>& trials,
                                           const std::vector<StructureAlias>& aliases,
                                           bool known_up, const PoseChoiceOptions& options);

/// Removes the poses whose shape_iou is below the best one's by more than `margin`.
void DropMisfits(double margin, std::vector<PoseCandidate>* poses);

/// Chooses among poses whose shape fits about equally well, given in the order of their shape_iou,
/// the best first: by the floor; then, among poses that stand on it equally well, by the network's
/// labels. These tell one step of a spiral from the next, but not up from down: a network that is
/// shown a part of the structure upside down labels it about as well.
PoseChoice Decide(const std::vector<PoseCandidate>& poses, const Structure& structure,
                  const PoseChoiceOptions& options);

}  // namespace volalign
