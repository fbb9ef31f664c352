#include "bindings/python/module.h"

#include "core/base/provenance.h"

PYBIND11_MODULE(_volalign, module) {
  using namespace volalign::python;
  module.attr("__version__") = volalign::Version();
  // Types before the functions that have them in their signatures.
  AddErrors(module);
  AddArrays(module);
  AddStructure(module);
  AddCapture(module);
  AddResult(module);
  AddCalibrate(module);
  AddCheck(module);
  AddPlan(module);
  AddConvert(module);
  AddSamples(module);
}
