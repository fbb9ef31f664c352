#pragma once

#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/checks/placement.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

/// The only capture of a capture, which has to outlive the result, with true labels and the initial
/// poses that follow from them, through the lenses as given.
inline Seen SeenWithLabels(const CaptureSet& input, const std::vector<LabelImage>& labels) {
  Seen seen;
  seen.input = &input;
  seen.lenses = GivenLenses(input);
  seen.views = LookThrough(input, seen.lenses, 1);
  seen.clouds = MapFrames(seen.views, 1, [&](FrameId id) { return SampleCloud(seen.views[id]); });
  seen.depths =
      PerFrame<DepthFinding>({CheckDepths(input.captures[0].frames, seen.views.OfCapture(0))});
  seen.labelled = MapFrames(seen.views, 1, [&](FrameId id) {
    Labelled of;
    of.segmentation = Certain(labels[id.frame]);
    of.quarter_turns = 1;
    of.initial = EstimateInitialPose(seen.views[id], of.segmentation, input.structure);
    return of;
  });
  return seen;
}

}  // namespace volalign::testing_infer
