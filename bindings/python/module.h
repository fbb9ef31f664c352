#pragma once

#include <pybind11/pybind11.h>

namespace volalign::python {

// What each source adds to the module `_volalign`.
void AddArrays(pybind11::module_& module);
void AddStructure(pybind11::module_& module);
void AddCapture(pybind11::module_& module);
void AddResult(pybind11::module_& module);
void AddCalibrate(pybind11::module_& module);
void AddCheck(pybind11::module_& module);
void AddPlan(pybind11::module_& module);
void AddConvert(pybind11::module_& module);
void AddSamples(pybind11::module_& module);

}  // namespace volalign::python
