#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "bindings/python/capture.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/result.h"
#include "bindings/python/work.h"
#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/geometry/stack_faults.h"
#include "infer/calib/calibrate.h"
#include "infer/segment_onnx/load.h"
#include "infer/view/network_segmenter.h"

namespace volalign::python {

namespace {

constexpr char kAutoModel[] = "auto", kInstalledModel[] = "models/m05-lite.onnx";

/// The captures' structure; none where none of them has one.
std::optional<Structure> CommonStructure(const std::vector<NamedCapture>& captures) {
  std::optional<Structure> common;
  for (const NamedCapture& capture : captures) {
    std::optional<Structure> structure = capture.ReadItsStructure();
    if (!structure) continue;
    if (common && common->Hash() != structure->Hash()) {
      throw ConfigError(fmt::format(
          "{} has another structure than the captures before it; give the one with structure=",
          capture.capture.path.string()));
    }
    common = std::move(structure);
  }
  return common;
}

/// The network that `model` names: None, a path, or "auto". Null where there is none.
std::unique_ptr<NetworkSegmenter> LoadModel(const CalibrateArguments& arguments,
                                            const std::optional<Structure>& structure) {
  if (arguments.model.is_none()) return nullptr;
  const std::string path = PathOf(arguments.model);
  if (path == kAutoModel) {
    const std::string installed = FindInputFile(kInstalledModel);
    if (!std::filesystem::exists(installed)) return nullptr;
    auto segmenter = LoadOnnxSegmenter(installed);
    const bool fits = !structure || segmenter->structure().Hash() == structure->Hash();
    return fits ? std::move(segmenter) : nullptr;
  }
  if (std::filesystem::path(path).extension() == ".safetensors") {
    throw ConfigError(fmt::format(
        "{} is a checkpoint of LibTorch, which this package does without; `volalign export --model "
        "{} --format onnx -o MODEL.onnx` makes a model for it",
        path, path));
  }
  return LoadOnnxSegmenter(path, structure ? &*structure : nullptr);
}

}  // namespace

std::shared_ptr<Calibration> CalibrateCapture(const CalibrateArguments& arguments) {
  const auto options =
      ReadConfig<CalibrateOptions>(SourceOf(arguments.options, arguments.keywords));
  std::vector<NamedCapture> captures = CapturesOf(arguments.capture);
  std::optional<Structure> structure =
      arguments.structure.is_none() ? CommonStructure(captures) : StructureOf(arguments.structure);
  const std::unique_ptr<NetworkSegmenter> segmenter = LoadModel(arguments, structure);
  if (!structure && segmenter) structure = segmenter->structure();
  if (!structure) {
    throw ConfigError(
        "there is neither a model nor a structure; describe the boxes and give them with "
        "structure=");
  }
  std::vector<std::string> files;
  std::vector<CaptureFile> read;
  for (NamedCapture& capture : captures) {
    files.push_back(capture.capture.path.string());
    // NameCaptures takes a name without its ending.
    if (capture.in_memory) capture.capture.path += ".";
    read.push_back(std::move(capture.capture));
  }
  for (const StackFault& fault : FindStackFaults(*structure)) {
    if (!fault.impossible && PyErr_WarnEx(PyExc_UserWarning, fault.text.c_str(), 1) != 0)
      throw py::error_already_set();
  }
  auto calibrated = std::make_shared<Calibration>();
  RunWork(arguments.progress, [&](const Tell& tell) {
    *calibrated = CalibrateFiles(NameCaptures(std::move(read)), std::move(files), *structure,
                                 segmenter.get(), options, tell);
  });
  return calibrated;
}

void AddCalibrate(py::module_& module) {
  module.def(
      "calibrate",
      [](const py::object& capture, const py::object& structure, const py::object& model,
         const py::object& options, const py::object& progress, const py::kwargs& keywords) {
        return CalibrateCapture({capture, structure, model, options, progress, keywords});
      },
      py::arg("capture"), py::kw_only(), py::arg("structure") = py::none(),
      py::arg("model") = "auto", py::arg("options") = py::none(), py::arg("progress") = py::none(),
      "Finds the poses of a capture's sensors.\n\ncapture: a Capture, the path of a capture.json, "
      "or a list of these, between which the stack was moved. Poses are in the frame of the stack "
      "in the first.\nstructure: a Structure or the path of one. None: the capture's, else the "
      "model's.\nmodel: path of an .onnx checkpoint. None: geometry alone. \"auto\": "
      "models/m05-lite.onnx if it is installed and knows this stack, else geometry alone "
      "(Result.model says which).\noptions: a dict, or the path of a YAML, with options of "
      "docs/config.md. Further keywords win: threads=4, initial={\"method\": \"geometry\"}, "
      "**{\"refine.size_sigma_percent\": 0.7}.\nprogress: called with a few words when a stage "
      "begins. An exception that it raises ends the calibration.\n\nA sensor that cannot be placed "
      "is \"failed\" in the Result; the others are placed without it. Raises ConfigError, "
      "DataError, IoError.");
}

}  // namespace volalign::python
