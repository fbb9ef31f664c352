#pragma once

#include <optional>
#include <variant>
#include <vector>

#include "core/pose.h"
#include "core/structure.h"
#include "infer/checks/assembly.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/pose/initial_pose.h"
#include "infer/pose/orientation.h"
#include "infer/refine/refine.h"
#include "infer/refine/sensor_points.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_lens.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A sensor whose own view fixes its pose, or that view together with its neighbours'.
struct PlacedSensor {
  Pose own_pose = Pose::Identity();  ///< refined alone, or with its neighbours where it needs them
  SensorPoints points;               ///< labelled by the own pose, for the joint refinement
  std::optional<Finding> suspect_intrinsics;  ///< other intrinsics fit clearly better
  /// Share of the structure's view that nothing hides, where geometry alone has found the pose.
  std::optional<double> visible_by_geometry;
  std::optional<Finding> by_neighbours;  ///< set where the sensor needs them, see neighbours.h

  /// What stands as the sensor's initial pose: one that its own view leaves open is none.
  const Pose& InitialPoseOf(const InitialPose& initial) const {
    return by_neighbours ? own_pose : initial.structure_from_sensor;
  }
};

/// A placed sensor, or why it is not placed.
using Placement = std::variant<Finding, PlacedSensor>;

struct PlacementOptions {
  const InitialPoseOptions& initial;
  const RefineOptions& refine;
  const VerdictOptions& verdict;
  const AssemblyOptions& assembly;
  int threads = 1;
};

/// A view, the intrinsics that it was made with, and the lens that they are of.
struct SeenView {
  const SensorView& view;
  const Intrinsics& intrinsics;
  const SensorLens& lens;
};

/// Its points, for the refinement.
SensorPoints SampleSeen(const SeenView& seen, const SegmentationResult& segmentation,
                        const Structure& structure, const PlacementOptions& options);

/// The sensor at a pose, with its points labelled by it.
PlacedSensor PlaceAt(const SeenView& seen, const Structure& structure, const Pose& pose,
                     const PlacementOptions& options);

/// InspectAssembly with the sensors that see many sides; the report's mirrored_frames are indices
/// of `views`. Nothing where none does, or where options.assembly leaves it out.
std::optional<AssemblyReport> InspectStack(const std::vector<SensorView>& views,
                                           const std::vector<LabelledView>& labelled,
                                           const Structure& structure,
                                           const PlacementOptions& options);

/// Refines each sensor alone and decides, by what its view then explains, whether it sees the
/// structure. A sensor in options.refine.without_structure, which its neighbours' overlap is to
/// hold, is taken at its initial pose. Where the stack is built otherwise than described, no sensor
/// is placed. One result a sensor; `depths`, `views` and `labelled` are
/// the frames', which have the intrinsics of `lenses`.
std::vector<Placement> PlaceSensors(const std::vector<SensorFrame>& frames,
                                    const std::vector<SensorView>& views,
                                    const std::vector<DepthFinding>& depths,
                                    const std::vector<LabelledView>& labelled,
                                    const std::optional<AssemblyReport>& assembly,
                                    const LensSet& lenses, const Structure& structure,
                                    const PlacementOptions& options);

/// The placed sensors, in order, as the joint refinement takes them, from their own poses on. What
/// it has to beat on held-out points is the keypoint pose: one that was fitted to the sensor's own
/// points has absorbed its warp and the boxes' offsets, and would win that comparison against
/// better poses. The placements must outlive the result.
std::vector<RefineFrame> FramesToRefine(const std::vector<SensorFrame>& frames,
                                        const std::vector<LabelledView>& labelled,
                                        const std::vector<Placement>& placements,
                                        const LensSet& lenses, const RefineOptions& options);

}  // namespace volalign
