#pragma once

#include <vector>

#include "core/pose.h"
#include "core/structure.h"
#include "infer/checks/placement.h"
#include "infer/refine/refine.h"
#include "infer/refine/sensor_points.h"
#include "infer/stills.h"
#include "infer/view/sensor_lens.h"

namespace volalign {

/// The poses of all placed sensors together, and what they were found from.
struct JointSolution {
  std::vector<RefineFrame> frames;   ///< those of FramesToRefine
  std::vector<SensorPoints> points;  ///< of frames that were labelled anew
  RefineResult refined;
};

/// Solves for all sensors together, with the labels that the solution itself implies: the stack as
/// it is found, seen from the poses that are found, labels the points anew, and everything is
/// solved again from there, until the poses stay. What the first labels came from, a network or
/// geometry, then makes little difference. `stood`: where the stack stood in each still
/// (JoinStills).
JointSolution SolveJointly(const Structure& structure, const std::vector<StillStages>& stages,
                           const LensSet& lenses, const std::vector<Pose>& stood,
                           const PlacementOptions& options);

/// A sensor that geometry alone has placed, and that the joint solution takes to where its view
/// does not have the structure's shape (VisibleWithShape), is placed no longer (no_structure).
/// `refined`: of FramesToRefine(*stages). Returns whether there is such a sensor.
bool DropWithoutShape(const RefineResult& refined, const PlacementOptions& options,
                      std::vector<StillStages>* stages);

}  // namespace volalign
