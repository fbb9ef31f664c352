#include "bindings/python/onnx_runtime.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

#include "bindings/python/arrays.h"
#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/segment_onnx/load.h"

namespace volalign::python {

namespace {

constexpr char kAuto[] = "auto", kOpenCv[] = "opencv", kOnnxRuntime[] = "onnxruntime";

/// Python's package; None where there is none.
py::object ImportOnnxRuntime() {
  try {
    return py::module_::import(kOnnxRuntime);
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ImportError)) throw;
    return py::none();
  }
}

/// One of `file`, whose bytes are given; its functions throw Error for what Python raises.
OnnxRuntime StartOnnxRuntime(const py::object& package, const std::string& file,
                             const std::string& bytes, int threads) {
  const std::string name =
      "ONNX Runtime " + py::str(package.attr("__version__")).cast<std::string>();
  const auto fail = [name, file](const py::error_already_set& error) {
    throw Error(fmt::format("{}: {} cannot run it: {}; runtime=\"{}\" does without", file, name,
                            py::str(error.value()).cast<std::string>(), kOpenCv));
  };
  py::object run;
  try {
    const py::object options = package.attr("SessionOptions")();
    options.attr("intra_op_num_threads") = threads;
    options.attr("inter_op_num_threads") = 1;
    py::list providers;
    providers.append("CPUExecutionProvider");
    run = package
              .attr("InferenceSession")(py::bytes(bytes), options, py::arg("providers") = providers)
              .attr("run");
  } catch (const py::error_already_set& error) {
    fail(error);
  }
  return {
      name, [run, fail](const DepthImage& depth) -> std::vector<float> {
        const py::gil_scoped_acquire acquired;
        try {
          py::dict inputs;
          inputs["depth"] = ArrayOf(nullptr, depth.data(), {1, 1, depth.height(), depth.width()});
          const py::list outputs = run(py::none(), inputs);
          const Input found = InputOf(outputs[0], "float32");
          const auto* values = static_cast<const float*>(found.memory.ptr);
          return {values, values + found.memory.size};
        } catch (const py::error_already_set& error) {
          fail(error);
          throw;
        }
      }};
}

}  // namespace

std::unique_ptr<NetworkSegmenter> LoadByRuntime(const std::string& file, const Structure* structure,
                                                const std::string& runtime, int threads) {
  if (runtime != kAuto && runtime != kOpenCv && runtime != kOnnxRuntime) {
    throw ConfigError(fmt::format("runtime = {} is none of {}, {}, {}", Shortened(runtime), kAuto,
                                  kOpenCv, kOnnxRuntime));
  }
  const py::object package = runtime == kOpenCv ? py::none() : ImportOnnxRuntime();
  if (package.is_none() && runtime == kOnnxRuntime) {
    throw ConfigError(
        "runtime = onnxruntime: Python has no package of this name; pip install onnxruntime, or "
        "leave it to runtime=\"opencv\"");
  }
  if (package.is_none()) return LoadOnnxSegmenter(file, structure);
  return LoadOnnxSegmenter(file, structure, [&](const std::string& bytes) {
    return StartOnnxRuntime(package, file, bytes, threads);
  });
}

}  // namespace volalign::python
