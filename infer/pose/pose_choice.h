#pragma once

#include <cstddef>
#include <vector>

#include "core/config.h"
#include "core/pose.h"
#include "core/structure.h"
#include "infer/pose/aliases.h"
#include "infer/pose/initial_pose.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// How poses of one frame are told from each other. Scores are Agreement::score, overlaps
/// DepthOverlap::ratio, floors FloorEvidence::share.
struct PoseChoiceOptions {
  double rival_score = 0.5;
  double overlap_margin = 0.1;
  double floor_margin = 0.05;
  double score_margin = 0.2;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("rival_score", rival_score,
       "share of the best orientation's agreement with labels and depth that another one needs to "
       "compete with it",
       Between(0, 1));
    ar("overlap_margin", overlap_margin,
       "difference of overlaps between what was seen and the structure from which on its shape "
       "decides between two poses; twice that before the poses are estimated again",
       Between(0, 1));
    ar("floor_margin", floor_margin,
       "difference of the shares of pixels that lie on the floor, those under it counted twice "
       "against it, from which on the floor decides",
       Between(0, 1));
    ar("score_margin", score_margin,
       "difference of agreements from which on the network's labels decide, though not about up "
       "and down",
       Between(0, 1));
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
struct PoseEvidence {
  Pose structure_from_sensor = Pose::Identity();
  PoseSource source = PoseSource::kNetwork;
  std::size_t trial = 0;     ///< index of the trial that it comes from, if it is the network's
  int alias = -1;            ///< index of the alias that moved the trial's pose; -1: none
  double overlap = 0;        ///< DepthOverlap::ratio: how well the shape fits
  double floor = 0;          ///< FloorEvidence::share
  double label_score = 0;    ///< Agreement::score of the trial's labels, renamed by the alias
  double network_score = 0;  ///< the best Agreement::score of all trials' labels, as they are
};

struct PoseChoice {
  bool found = false;
  /// Of the poses that are about the one chosen, that with the best label_score: its trial and
  /// alias say which labels suit the pose. Its network_score is the best of all these.
  PoseEvidence best;
  /// Another pose that shape, floor and labels speak for about as much.
  bool ambiguous = false;
  PoseEvidence rival;
  /// Upside down it would be as good, but then contradict the other sensors of the rig, or it
  /// contradicts them now.
  bool up_unknown = false;
};

/// The poses that compete for a view, judged: see ChoosePose. Those of which shape speaks for
/// another are left out; the others are in the order of their overlap, the best first.
std::vector<PoseEvidence> FindCompetitors(const SensorView& view, const Structure& structure,
                                          const std::vector<StructureAlias>& aliases,
                                          const std::vector<PoseTrial>& trials, bool known_up,
                                          const InitialPoseOptions& initial,
                                          const PoseChoiceOptions& options);

/// Decide among FindCompetitors: chooses among the trials' poses and their aliases. Each competing
/// pose is estimated again with the labels that it implies. Then the shape of what was seen
/// decides, whatever the labels say; then the floor; then, among poses that stand on it equally
/// well, the network's labels. These tell one step of a spiral from the next, but not up from down:
/// a network that is shown a part of the structure upside down labels it about as well. With
/// `known_up`, the trials' orientation is given, and poses that turn the structure over are left
/// out.
PoseChoice ChoosePose(const SensorView& view, const Structure& structure,
                      const std::vector<StructureAlias>& aliases,
                      const std::vector<PoseTrial>& trials, bool known_up,
                      const InitialPoseOptions& initial, const PoseChoiceOptions& options);

// The steps of ChoosePose that need no image.

/// Does one of two poses of a sensor turn the structure over?
bool TurnsOver(const Pose& from, const Pose& to);

/// The poses of the trials, and of their aliases, that compete: of every trial whose agreement is
/// at least options.rival_score of the best one's.
std::vector<PoseEvidence> ListCompetitors(const std::vector<PoseTrial>& trials,
                                          const std::vector<StructureAlias>& aliases, bool known_up,
                                          const PoseChoiceOptions& options);

/// Removes the poses whose overlap is below the best one's by more than `margin`.
void DropMisfits(double margin, std::vector<PoseEvidence>* poses);

/// Chooses among poses whose shape fits about equally well, by floor and labels. They are given in
/// the order of their overlap, the best first.
PoseChoice Decide(const std::vector<PoseEvidence>& poses, const Structure& structure,
                  const PoseChoiceOptions& options);

}  // namespace volalign
