#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "infer/checks/assembly.h"
#include "infer/checks/depth_checks.h"
#include "infer/checks/placement.h"
#include "infer/judge.h"
#include "infer/pose/orientation.h"
#include "infer/refine/refine.h"
#include "infer/refine/straightness.h"
#include "infer/result.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_lens.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// A still on its way through the stages of a calibration: what they found, one element a frame.
struct StillStages {
  const Still* still;             ///< as given
  std::size_t first = 0;          ///< index of its first frame among those of all stills
  std::vector<SensorFrame> seen;  ///< its frames, with the intrinsics of the lenses
  std::vector<SensorView> views;
  std::vector<DepthFinding> depths;
  std::vector<LabelledView> labelled;
  std::optional<AssemblyReport> assembly;
  std::vector<Placement> placements;

  /// Of its frames, from those of all.
  LensSet Lenses(const LensSet& lenses) const { return OfFrames(lenses, first, seen.size()); }
};

/// The frames of all stills, still by still: the order in which those of all are counted.
std::vector<SensorFrame> AllFrames(const std::vector<Still>& stills);

/// Stills that nothing has been found about. `stills` must outlive the result.
std::vector<StillStages> BeginStages(const std::vector<Still>& stills);

/// Looks at every frame through `lenses`, those of all frames.
void SeeThrough(const LensSet& lenses, int threads, std::vector<StillStages>* stages);

/// Large planes of all frames, see FindPlanes.
std::vector<SensorPlanes> FindPlanes(const std::vector<StillStages>& stages, const LensSet& lenses,
                                     int threads);

/// All placed frames, still by still, as the joint refinement takes them. Sensors are counted in
/// the order in which their names first occur.
std::vector<RefineFrame> FramesToRefine(const std::vector<StillStages>& stages,
                                        const LensSet& lenses, const RefineOptions& options);

/// Judges every still, its frames by the refinement of all. `suspect_lenses`: of all frames.
std::vector<CalibrationResult> JudgeStills(
    std::vector<StillStages> stages, const Structure& structure, const RefineResult& refined,
    const LensSet& lenses, const std::vector<std::optional<Finding>>& suspect_lenses,
    const JudgeOptions& options);

}  // namespace volalign
