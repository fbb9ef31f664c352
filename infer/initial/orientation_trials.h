#pragma once

// What the network makes of views in different orientations. Not for callers of LabelViews.

#include <cstddef>
#include <vector>

#include "core/base/stage_clock.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/orientation.h"
#include "infer/view/segmentation.h"
#include "infer/view/segmenter.h"

namespace volalign::pose_internal {

/// What does not change while views are labelled.
struct LabelContext {
  const std::vector<LabelRequest>& views;
  const Structure& structure;
  const std::vector<StructureAlias> aliases;
  Segmenter* segmenter;
  const InitialPoseOptions& initial;
  const OrientationOptions& options;
  int threads;
  StageClock* clock;
};

/// A view in one orientation: what the network sees in it, and the pose that follows.
struct OrientationTrial {
  std::size_t view = 0;
  int turns = 0;
  SegmentationResult segmentation;
  InitialPose initial;
  // Natural logarithms of the odds of the pose:
  double by_view = 0;   // by depths and labels
  double by_floor = 0;  // against that of any alias (FloorMargin)
};

/// Beyond doubt: labels and depths fit the structure, and it stands on a floor. Upside down, or
/// shifted by a box, it would not.
bool Settled(const OrientationTrial& trial);

/// All trials that are needed to know every view's orientation; see LabelViews.
std::vector<OrientationTrial> TryOrientations(const LabelContext& context);

/// The trial for whose pose most speaks.
OrientationTrial* BestTrial(const std::vector<OrientationTrial*>& trials);

}  // namespace volalign::pose_internal
