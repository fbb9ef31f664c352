#pragma once

#include <optional>
#include <vector>

#include "infer/checks/placement.h"
#include "infer/checks/rig_findings.h"
#include "infer/view/frames.h"

namespace volalign {

/// The prior of a located frame's pose, after comparison with what the frames show.
struct PlacedPrior {
  /// As a pose first_from_sensor, in the world that suits most located frames. PosePrior::world
  /// says which motion of that world is open.
  PosePrior prior;
  Vector6d difference = Vector6d::Zero();  ///< from the prior's pose to the frame's own
  /// Half the squared difference, in standard deviations of both.
  double misfit = 0;
  bool used = true;  ///< false: chance explains the difference in less than one of a thousand

  /// The probability that chance makes such a difference, or a larger one.
  double Chance() const;
};

/// The priors of the frames of a capture, if they have one. In all captures but the first, the
/// structure stands anywhere in the priors' world.
std::vector<std::optional<PosePrior>> PriorsOfCapture(const CaptureSet& input, std::size_t capture);

/// The priors of all located frames. `first_from_stack`: for each capture.
SomeFrames<PlacedPrior> PlacePriors(const Seen& seen, const PerFrame<LocateResult>& results,
                                    const std::vector<Pose>& first_from_stack);

/// Findings about priors that the frames contradict. If most do, but agree with each other, that is
/// one finding about the structure's place.
std::vector<RigFinding> ExplainPriors(const Seen& seen, const PerFrame<LocateResult>& results,
                                      const std::vector<Pose>& first_from_stack);

}  // namespace volalign
