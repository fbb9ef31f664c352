#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/report/extrinsics.h"
#include "infer/view/sensor_frame.h"

namespace volalign::python {

/// A calibration with all that its files are written from: Python's Result.
struct Calibrated {
  std::vector<Capture> captures;
  Structure structure;
  CalibrationResult result;
  ExtrinsicsSource source;
  std::string options;  ///< all of them, YAML

  Extrinsics MakeExtrinsics() const {
    return volalign::MakeExtrinsics(result, captures, structure, source);
  }
};

}  // namespace volalign::python
