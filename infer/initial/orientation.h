#pragma once

#include <string>
#include <vector>

#include "core/base/stage_clock.h"
#include "core/config/config.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/pose_prior.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct OrientationOptions {
  std::vector<std::string> choose;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("choose", choose,
       "poses to take, SENSOR=NUMBER each. 1 is the pose that would be chosen; higher numbers are "
       "the alternatives (`twins` in extrinsics.json)",
       FormerlyNamed("twins"));
  }
};

/// A frame to be labelled. The referenced values must outlive the call.
struct LabelRequest {
  const SensorView* view = nullptr;
  const Intrinsics* intrinsics = nullptr;
  /// Clockwise turns into the network's orientation, 0-3; kAutoTurns: they are to be found.
  int quarter_turns = 0;
  bool usable = true;                ///< false: gets no labels and no pose
  int chosen = 0;                    ///< SensorHypotheses::chosen
  const PosePrior* prior = nullptr;  ///< of its pose in this capture; null: none
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

/// A frame with its labels, and the pose that follows from them.
struct Labelled : LabelledPose {
  int quarter_turns = 0;  ///< clockwise turns into the network's orientation
  /// Description of the structure at another pose that explains the view about as well: "upside
  /// down". Empty if there is no such pose.
  std::string other_pose;
  std::vector<PoseAlternative> alternatives;  ///< PoseChoice::alternatives
  bool given = false;                         ///< PoseChoice::given
  bool floor_would_tell = true;               ///< LeavesFloor: a seen floor would refute other_pose
  /// Source of the initial pose; where none was found, the source that was asked last.
  PoseSource source = PoseSource::kNetwork;

  /// The network's labels, else null: labels that a pose implies say nothing about it.
  const SegmentationResult* ByNetwork() const {
    return source == PoseSource::kNetwork ? &segmentation : nullptr;
  }
};

/// Labels every view and finds its initial pose. There is one result per view, in order.
///
/// Where the turns are to be found, the network's own orientation is tried first. The first view
/// that this does not settle is tried in the three others. Sensors of a rig are usually mounted
/// alike, so the turn that settles it is tried next on the other open views. Views that stay open
/// are tried in all four. Where not exactly one orientation is beyond doubt, the poses of all
/// orientations and their symmetries (StructureSymmetry) are hypotheses. Unless `initial.method`
/// leaves geometry out, it proposes poses too (FindPosesByGeometry). Without a `segmenter` (null),
/// it proposes all of them. Frames of one size go through the network together. Adds "segmentation"
/// and "initial_pose" to `clock`.
std::vector<Labelled> LabelViews(const std::vector<LabelRequest>& views, const Structure& structure,
                                 Segmenter* segmenter, const InitialPoseOptions& initial,
                                 int threads, StageClock* clock);

}  // namespace volalign
