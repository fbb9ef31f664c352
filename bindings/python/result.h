#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "infer/report/export.h"

namespace volalign::python {

/// What `calibrate` and `check` have in common. Each as in `calibrate`.
struct CalibrateArguments {
  pybind11::object capture, structure, model;
  pybind11::object options, progress;
  pybind11::dict keywords;
};

std::shared_ptr<Calibration> CalibrateCapture(const CalibrateArguments& arguments);

}  // namespace volalign::python
