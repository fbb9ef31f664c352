#pragma once

#include <vector>

#include "infer/refine/refine.h"
#include "infer/result.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// The result of all stills, from those of each alone. The sensors come in the order in which their
/// names first occur, each with its pose in the first still's structure, without images. A sensor
/// is as well placed as in the still where it is placed best, but for what says that it, not its
/// view of one still, is not as it should be. `frames`: those that were refined, see
/// FramesToRefine.
CalibrationResult CombineStills(const std::vector<Still>& stills,
                                std::vector<CalibrationResult> judged,
                                const std::vector<RefineFrame>& frames,
                                const RefineResult& refined);

}  // namespace volalign
