#include "bindings/python/module.h"

#include <exception>
#include <system_error>
#include <utility>

#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/base/provenance.h"
#include "core/base/text.h"

namespace volalign::python {

namespace py = pybind11;

namespace {

void AddErrors(py::module_& module) {
  auto error = py::register_exception<Error>(module, "Error");
  error.doc() = "Base of what volalign raises: one line that says what is wrong and what to do.";
  py::register_exception<ConfigError>(module, "ConfigError", error).doc() =
      "An option is unknown, of the wrong type or out of its range.";
  py::register_exception<DataError>(module, "DataError", error).doc() =
      "A file or an array is not what its format promises.";
  py::register_exception<IoError>(module, "IoError", error).doc() =
      "A file or device cannot be opened, read or written.";

  // Of files, and of threads that the system does not give.
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      std::rethrow_exception(std::move(thrown));
    } catch (const std::system_error& failed) {
      PyErr_SetString(py::module_::import("volalign").attr("Error").ptr(),
                      SentenceOf(failed).c_str());
    }
  });
  module.def(
      "_use_data_near", [](const std::string& file) { SetDataFolder(DataFolderNear(file)); },
      py::arg("file"));
  module.def("data_folder", &DataFolder,
             "Folder that has configs and models: relative paths of inputs that are not in the "
             "working directory are looked for there. The environment's VOLALIGN_DATA_DIR names "
             "another one before the import. Empty where there is none.");
}

}  // namespace

}  // namespace volalign::python

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
