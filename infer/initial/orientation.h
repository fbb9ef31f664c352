#pragma once

#include <string>
#include <vector>

#include "core/base/stage_clock.h"
#include "core/config/config.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/pose_choice.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct OrientationOptions {
  std::vector<std::string> choose;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("choose", choose,
       "alternative poses to take, SENSOR=NUMBER each: 1 is the pose that would be chosen, higher "
       "numbers are those of twins in extrinsics.json",
       FormerlyNamed("twins"));
  }
};

/// A frame that is to be labelled. The referenced values must outlive the call.
struct LabelRequest {
  const SensorView* view = nullptr;
  const Intrinsics* intrinsics = nullptr;
  /// Clockwise turns into the network's orientation, 0-3, or kAutoTurns where they are to be found.
  int quarter_turns = 0;
  bool usable = true;  ///< false: gets no labels and no pose
  int chosen = 0;      ///< SensorCandidates::chosen
  /// If not null, the pose that this frame keeps: it gets no labels, and the poses of the other
  /// frames are chosen to agree with it.
  const Pose* known = nullptr;
};

/// A frame with its labels, and the pose that follows from them.
struct Labelled {
  SegmentationResult segmentation;  ///< full size, the frame's own orientation
  int quarter_turns = 0;            ///< that brought the frame into the network's orientation
  InitialPose initial;
  /// How the structure would stand at another pose that explains the view about as well ("upside
  /// down"); empty where there is none.
  std::string other_pose;
  std::vector<PoseAlternative> alternatives;  ///< PoseChoice::alternatives
  bool given = false;                         ///< PoseChoice::given
  /// PoseChoice::up_unknown: this sensor's pose or the others' would be wrong.
  bool up_unknown = false;
  bool floor_would_tell = true;  ///< whether it is that other pose
  /// Of the initial pose; where none was found, what was asked last.
  PoseSource source = PoseSource::kNetwork;

  /// The labels, where they are a network's: those that a pose implies say nothing of it. Else
  /// null.
  const SegmentationResult* ByNetwork() const {
    return source == PoseSource::kNetwork ? &segmentation : nullptr;
  }
};

/// Labels every view and finds its initial pose, one result a view, in order.
///
/// Where the turns are to be found, the network's own orientation is tried first. The first view
/// that this does not decide is tried in the three others, and, sensors of a rig being mounted
/// alike, the turn that it is decided by is tried on the rest; what stays open is tried in all
/// four. Where not exactly one orientation is beyond doubt, the orientations' poses and their
/// aliases (infer/initial/aliases.h) compete. Frames of one size go through the network together.
/// Unless `initial.method` leaves it out, geometry proposes poses, too (pose_sources.h): all of
/// them without a `segmenter`, which may be null.
/// Adds "segmentation" and "initial_pose" to `clock`.
std::vector<Labelled> LabelViews(const std::vector<LabelRequest>& views, const Structure& structure,
                                 Segmenter* segmenter, const InitialPoseOptions& initial,
                                 const OrientationOptions& options, int threads, StageClock* clock);

/// Finds the initial pose again, near where it was, for a view whose rays have changed: with the
/// network's labels as they are; what geometry has found is labelled again by its pose.
Labelled UpdateInitialPose(const SensorView& view, Labelled labelled, const Structure& structure,
                           const InitialPoseOptions& initial);

}  // namespace volalign
