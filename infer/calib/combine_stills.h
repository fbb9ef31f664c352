#pragma once

#include <vector>

#include "infer/calib/joint_solution.h"
#include "infer/calib/result.h"
#include "infer/view/frames.h"

namespace volalign {

/// The result of all stills, from those of each alone, but for the size, the solution's report and
/// the timings. The sensors come in the order of CaptureSet::sensors, each with its pose in the
/// first still's structure, without images. A sensor is as well placed as in the still where it is
/// placed best, but for what says that it, not its view of one still, is not as it should be.
CalibrationResult CombineStills(const CaptureSet& capture, std::vector<StillResult> stills,
                                const SomeFrames<FrameSolution>& frames);

}  // namespace volalign
