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

/// Everything that the frames show one by one, seen through their lenses.
struct Seen {
  const CaptureSet* input = nullptr;  ///< has to outlive this
  LensSet lenses;
  PerFrame<SensorView> views;
  PerFrame<DepthFinding> depths;
  PerFrame<Labelled> labelled;
  PerFrame<SampledCloud> clouds;  ///< SampleCloud of each view; needed from LocateAlone on
};

/// A frame whose pose its own view fixes, alone or together with its prior.
struct LocatedFrame {
  Pose own_pose = Pose::Identity();            ///< refined alone
  std::shared_ptr<const SensorPoints> points;  ///< labelled by the own pose
  /// ShapeLogOdds, if geometry alone has found the pose.
  std::optional<double> shape_log_odds;
  /// Covariance of own_pose, see RefinedFrame::covariance. Zero if a prior helped.
  Matrix6d covariance = Matrix6d::Zero();
};

/// A located frame, or why it is not.
using LocateResult = std::variant<LocatedFrame, Finding>;

struct LocateOptions {
  const RefineOptions& refine;
  const VerdictOptions& verdict;
  int threads = 1;
};

/// Points of a frame for the refinement, with the labels that `structure` has at `pose`.
std::shared_ptr<const SensorPoints> PointsAt(const Seen& seen, FrameId id,
                                             const Structure& structure, const Pose& pose,
                                             const LocateOptions& options);

/// The stack's arrangement in each capture, with its frames as views. Nothing if that was not
/// examined.
using StackFinding = std::vector<std::optional<AssemblyReport>>;

/// Refines each frame alone and decides by its explained view whether it shows the structure. If
/// the stack is built otherwise than described, no frame is located. A mirrored frame is not
/// located either.
PerFrame<LocateResult> LocateAlone(const Seen& seen, const StackFinding& stack,
                                   const LocateOptions& options);

/// Locates frames that their own view does not place, but that show the structure at their prior's
/// pose. The world of the priors is that in which the located frames of the capture are. `seen`
/// gets the labels that such a pose implies. A frame that is not located keeps its finding.
PerFrame<LocateResult> LocateByPriors(PerFrame<LocateResult> results, const LocateOptions& options,
                                      Seen* seen);

/// The located frames as input of the joint refinement, which begins at their own poses.
SomeFrames<FrameInput> FramesToRefine(const Seen& seen, const PerFrame<LocateResult>& results);

}  // namespace volalign
