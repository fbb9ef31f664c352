#pragma once

#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/checks/assembly.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/orientation.h"
#include "infer/lens/sensor_lens.h"
#include "infer/refine/refine.h"
#include "infer/refine/sensor_points.h"
#include "infer/view/frames.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What every frame shows by itself, seen through its lens.
struct Seen {
  const CaptureSet* capture = nullptr;  ///< has to outlive this
  LensSet lenses;
  PerFrame<SensorView> views;
  PerFrame<DepthFinding> depths;
  PerFrame<Labelled> labelled;
  PerFrame<SampledCloud> clouds;  ///< SampleCloud of each view; needed from LocateAlone on
};

/// A frame whose own view fixes its pose, or that view together with its neighbours'.
struct LocatedFrame {
  Pose own_pose = Pose::Identity();  ///< refined alone, or with its neighbours where it needs them
  std::shared_ptr<const SensorPoints> points;  ///< labelled by the own pose
  std::optional<Finding> suspect_intrinsics;   ///< other intrinsics fit clearly better
  /// ShapeLogOdds, where geometry alone has found the pose.
  std::optional<double> shape_log_odds;
  std::optional<Finding> by_neighbours;  ///< set where the sensor needs them, see neighbours.h
  std::vector<FrameId> rests_on;  ///< those neighbours, the one that it shares most with first

  /// What stands as the frame's initial pose: one that its own view leaves open is none.
  const Pose& InitialPoseOf(const InitialPose& initial) const {
    return by_neighbours ? own_pose : initial.structure_from_sensor;
  }
};

/// A located frame, or why it is not.
using LocateResult = std::variant<LocatedFrame, Finding>;

struct LocateOptions {
  const InitialPoseOptions& initial;
  const RefineOptions& refine;
  const VerdictOptions& verdict;
  int threads = 1;
};

/// Points of a frame for the refinement, with these labels or with those that a pose of the frame
/// gives them, the structure being as it is here.
std::shared_ptr<const SensorPoints> PointsOf(const Seen& seen, FrameId id,
                                             const SegmentationResult& segmentation,
                                             const LocateOptions& options);
std::shared_ptr<const SensorPoints> PointsAt(const Seen& seen, FrameId id,
                                             const Structure& structure, const Pose& pose,
                                             const LocateOptions& options);

/// How the stack is built, by each still, its frames being the views; nothing where that was not
/// asked.
using StackFinding = std::vector<std::optional<AssemblyReport>>;

/// Refines each frame alone and decides, by what its view then explains, whether it sees the
/// structure. Where the stack is built otherwise than described, no frame is located, nor is one
/// that is mirrored.
PerFrame<LocateResult> LocateAlone(const Seen& seen, const StackFinding& stack,
                                   const LocateOptions& options);

/// The located frames as the joint refinement takes them, from their own poses on.
SomeFrames<FrameInput> FramesToRefine(const Seen& seen, const PerFrame<LocateResult>& results);

}  // namespace volalign
