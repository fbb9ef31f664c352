#pragma once

#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/view/frames.h"

namespace volalign {

/// What is to be calibrated. Throws ConfigError or DataError for what no stage of Calibrate could
/// make sense of. `model`: there is a network.
CaptureSet CheckRequest(std::vector<Still> stills, Structure structure,
                        const CalibrateOptions& options, bool model);

/// An element of orientation.choose: the pose of that number, PoseAlternative::number, is asked
/// for.
struct SensorNumber {
  std::string sensor;
  int number = 1;
};
/// Of "SENSOR=NUMBER". Throws ConfigError.
SensorNumber ParseChoice(const std::string& text);

}  // namespace volalign
