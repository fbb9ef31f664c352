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

/// What `calibrate` and `check` have in common. Each as in `calibrate`.
struct CalibrateArguments {
  pybind11::object capture, structure, model;
  pybind11::object options, progress;
  pybind11::dict keywords;
};

std::shared_ptr<Calibrated> CalibrateCapture(const CalibrateArguments& arguments);

}  // namespace volalign::python
