#pragma once

#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/view/frames.h"

namespace volalign {

/// Checks the arguments of Calibrate and drops stand-in depths (DropStandIns). Throws ConfigError
/// or DataError for input that no stage could use. `model`: there is a network.
CaptureSet CheckRequest(std::vector<Capture> captures, Structure structure,
                        const CalibrateOptions& options, bool model);

/// An element of orientation.choose: a sensor and its requested PoseAlternative::number.
struct SensorNumber {
  std::string sensor;
  int number = 1;
};
/// Parses "SENSOR=NUMBER". Throws ConfigError.
SensorNumber ParseChoice(const std::string& text);

}  // namespace volalign
