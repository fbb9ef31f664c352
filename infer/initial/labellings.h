#pragma once

// The network's results in different orientations. Not for callers of LabelViews.

#include <vector>

#include "core/base/stage_clock.h"
#include "core/geometry/structure.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/orientation.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/symmetries.h"
#include "infer/view/segmenter.h"

namespace volalign::pose_internal {

/// The constants of one call of LabelViews.
struct LabelContext {
  const std::vector<LabelRequest>& views;
  const Structure& structure;
  const std::vector<StructureSymmetry> symmetries;
  Segmenter* segmenter;
  const InitialPoseOptions& initial;
  int threads;
  StageClock* clock;
};

/// Is the labelling beyond doubt? Labels and depths then fit the structure, and it stands on a
/// floor. Upside down, or shifted by a box, it would not.
bool Settled(const Labelling& labelling);

/// All labellings that are needed to know every view's orientation; see LabelViews.
std::vector<Labelling> TryOrientations(const LabelContext& context);

/// The most probable labelling.
const Labelling* BestLabelling(const std::vector<const Labelling*>& labellings);

}  // namespace volalign::pose_internal
