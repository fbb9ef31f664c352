#pragma once

#include <utility>
#include <vector>

#include "infer/calib/calibrate.h"
#include "infer/checks/placement.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

/// The only still of a capture, which has to outlive the result, with true labels and the initial
/// poses that follow from them, through the lenses as given.
inline Seen SeenWithLabels(const CaptureSet& capture, const std::vector<LabelImage>& labels) {
  const CalibrateOptions options;
  Seen seen;
  seen.capture = &capture;
  seen.lenses = GivenLenses(capture);
  seen.views = LookThrough(capture, seen.lenses, 1);
  seen.clouds = MapFrames(seen.views, 1, [&](FrameId id) { return SampleCloud(seen.views[id]); });
  seen.depths =
      PerFrame<DepthFinding>({CheckDepths(capture.stills[0].frames, seen.views.OfStill(0))});
  seen.labelled = MapFrames(seen.views, 1, [&](FrameId id) {
    Labelled of;
    of.segmentation = Certain(labels[id.frame]);
    of.quarter_turns = 1;
    of.initial =
        EstimateInitialPose(seen.views[id], of.segmentation, capture.structure, options.initial);
    return of;
  });
  return seen;
}

}  // namespace volalign::testing_infer
