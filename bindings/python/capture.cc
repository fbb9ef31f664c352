#include "bindings/python/capture.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/work.h"
#include "core/base/error.h"
#include "core/base/text.h"
#include "core/geometry/structure.h"
#include "infer/capture/mean_depth.h"
#include "infer/formats/depth_file.h"

namespace volalign::python {

namespace {

constexpr double kMillimetre = 0.001;

/// numpy's array of `depth`: what a masked array masks is 0, and a last axis of one channel is
/// gone.
py::object PlainArray(const py::object& depth) {
  const py::module_ numpy = py::module_::import("numpy");
  py::object array = numpy.attr("asarray")(numpy.attr("ma").attr("filled")(depth, 0));
  const auto axes = array.attr("ndim").cast<int>();
  if (axes < 3 || axes > 4) return array;
  const auto last = py::object(array.attr("shape"))[py::int_(-1)].cast<py::ssize_t>();
  return last == 1 ? array.attr("squeeze")(-1) : array;
}

/// Whether the principal point is where it would be in the image with height and width exchanged.
bool LooksTransposed(const Intrinsics& k) {
  constexpr double kShare = 0.08;  // of the longer side: further off than sensors' own are
  const auto off = [&](double width, double height) {
    return std::max(std::abs(k.cx - (width - 1) / 2), std::abs(k.cy - (height - 1) / 2));
  };
  const double given = off(k.width, k.height);
  return given > kShare * std::max(k.width, k.height) && 3 * off(k.height, k.width) < given;
}

/// The images of (H, W) or (N, H, W) values.
std::vector<StoredDepth> ImagesOf(const Input& input, bool whole_numbers, const std::string& name) {
  const std::vector<py::ssize_t>& shape = input.memory.shape;
  if ((shape.size() != 2 && shape.size() != 3) || input.memory.size == 0) {
    throw DataError(fmt::format(
        "{}: depth has {} axes and {} values; (height, width), or (frames, height, width) of one "
        "still scene, is expected",
        name, shape.size(), input.memory.size));
  }
  const auto height = shape[shape.size() - 2], width = shape.back();
  if (width <= 4) {
    throw DataError(fmt::format(
        "{}: the last axis of depth has {} values; depth is one channel, (height, width)", name,
        width));
  }
  formats_internal::RequireSize(width, height, name);
  const auto* values = static_cast<const float*>(input.memory.ptr);
  std::vector<StoredDepth> images;
  for (const float* end = values + input.memory.size; values < end; values += width * height) {
    StoredDepth image{{static_cast<int>(width), static_cast<int>(height)}, whole_numbers};
    std::copy_n(values, width * height, image.values.begin());
    CleanDepth(name, &image);
    images.push_back(std::move(image));
  }
  return images;
}

SensorFrame MakeFrame(const std::string& name, const py::object& depth, double fx, double fy,
                      double cx, double cy, std::vector<double> distortion,
                      std::optional<double> depth_scale, const std::string& sensor,
                      std::optional<int> quarter_turns, const std::string& serial,
                      const py::object& ground_truth, const py::object& prior,
                      const std::string& prior_world,
                      const std::pair<double, double>& prior_sigma) {
  if (!IsFileName(name)) {
    throw DataError(fmt::format("the name \"{}\" has to serve as a file name",
                                Shortened(name, kMostNameBytes)));
  }
  RequirePlainText(sensor, name + ": sensor");
  RequirePlainText(serial, name + ": serial");
  const py::object array = PlainArray(depth);
  const auto kind = array.attr("dtype").attr("kind").cast<std::string>();
  if (kind != "f" && !(kind == "u" && array.attr("itemsize").cast<int>() == 2)) {
    throw DataError(
        fmt::format("{}: depth is of {}; floats (metres) or uint16 (millimetres) are expected",
                    name, py::str(array.attr("dtype")).cast<std::string>()));
  }
  SensorFrame frame;
  frame.name = name;
  frame.depth_scale = depth_scale.value_or(kind == "f" ? 1.0 : kMillimetre);
  if (!(frame.depth_scale > 0) || !std::isfinite(frame.depth_scale)) {
    throw DataError(
        fmt::format("{}: depth_scale = {} violates depth_scale > 0", name, frame.depth_scale));
  }
  SetMeanDepth(ImagesOf(InputOf(array, "float32"), kind == "u", name), &frame);
  frame.intrinsics = {frame.depth.width(),  frame.depth.height(), fx, fy, cx, cy,
                      std::move(distortion)};
  frame.intrinsics.Validate(name);
  if (LooksTransposed(frame.intrinsics)) {
    throw DataError(fmt::format(
        "{}: depth has {} rows of {} pixels, but cx = {:g}, cy = {:g} fit the image with rows and "
        "columns exchanged. Transpose the array (depth.T), or correct cx and cy",
        name, frame.depth.height(), frame.depth.width(), cx, cy));
  }
  if (quarter_turns && (*quarter_turns < 0 || *quarter_turns > 3)) {
    throw DataError(
        fmt::format("{}: quarter_turns = {} is neither 0, 1, 2, 3 nor None", name, *quarter_turns));
  }
  frame.quarter_turns = quarter_turns.value_or(kAutoTurns);
  frame.sensor = sensor;
  frame.serial = serial;
  if (!ground_truth.is_none()) frame.ground_truth = PoseOf(ground_truth, name + ": ground_truth");
  if (!prior.is_none()) {
    PriorWorld world{};
    if (!FromWord(prior_world, &world)) {
      throw DataError(fmt::format("{}: prior_world = \"{}\" is none of {}", name,
                                  Shortened(prior_world),
                                  fmt::join(WordsOfAll<PriorWorld>(), ", ")));
    }
    frame.prior =
        PosePrior{PoseOf(prior, name + ": prior"), world, prior_sigma.first, prior_sigma.second};
  }
  return frame;
}

NamedCapture MakeCapture(std::vector<SensorFrame> frames, const py::object& structure,
                         const std::string& name) {
  NamedCapture made;
  if (frames.empty()) throw DataError("a capture needs at least one frame");
  std::set<std::string> names;
  for (const SensorFrame& frame : frames) {
    if (!names.insert(frame.name).second) {
      throw DataError(
          fmt::format("two sensors are named \"{}\"; names must be unique", frame.name));
    }
  }
  made.in_memory = true;
  made.capture.path = name;
  made.capture.sensors = std::move(frames);
  if (!structure.is_none()) made.structure = StructureOf(structure);
  return made;
}

NamedCapture LoadCapture(const Path& path) {
  const std::string file = PathOf(path);
  return Working([&] { return NamedCapture{ReadCapture(file), std::nullopt, false}; });
}

void AddFrame(py::module_& module) {
  py::class_<SensorFrame, std::shared_ptr<SensorFrame>>(
      module, "Frame", "A sensor's still frame: depth along the optical axis, and its camera.")
      .def(py::init(&MakeFrame), py::arg("name"), py::arg("depth"), py::kw_only(), py::arg("fx"),
           py::arg("fy"), py::arg("cx"), py::arg("cy"),
           py::arg("distortion") = std::vector<double>(), py::arg("depth_scale") = py::none(),
           py::arg("sensor") = "", py::arg("quarter_turns") = py::none(), py::arg("serial") = "",
           py::arg("ground_truth") = py::none(), py::arg("prior") = py::none(),
           py::arg("prior_world") = ToString(PriorWorld::kStructure),
           py::arg("prior_sigma") = std::make_pair(PosePrior().sigma_m, PosePrior().sigma_deg),
           "depth: (H, W), or (N, H, W) of one still scene, of which it is the mean; a last axis "
           "of 1 is left out. Masked values of a masked array are no measurement. Floats are "
           "metres, uint16 millimetres; depth_scale gives other metres per unit. 0, NaN, infinity "
           "and negative values are no measurement. The array is copied. Raises DataError.\nfx, "
           "fy, cx, cy, distortion: see Intrinsics.\nsensor: the kind of device, such as "
           "\"azure_kinect_nfov_binned\".\nquarter_turns: clockwise turns, 0 to 3, that bring the "
           "image into the network's orientation. None: they are found.\nground_truth: (4, 4) "
           "structure_from_sensor. Errors against it are reported.\nprior: (4, 4), the pose as it "
           "is known beforehand. prior_sigma: its standard deviations, m and deg.\nprior_world: "
           "\"structure\": it is structure_from_sensor. \"metric\": it is in another world, in "
           "metres. \"free\": that world has any scale.")
      .def_readonly("name", &SensorFrame::name)
      .def_property_readonly(
          "depth",
          [](const std::shared_ptr<SensorFrame>& frame) { return ViewOf(frame, frame->depth); },
          "(H, W) float32, m, read-only.")
      .def_property_readonly(
          "depth_sigma",
          [](const std::shared_ptr<SensorFrame>& frame) {
            return ViewOf(frame, frame->depth_sigma);
          },
          "(H, W) float32, m, read-only: standard error of each depth; None of a single frame.")
      .def_readonly("intrinsics", &SensorFrame::intrinsics)
      .def_readonly("sensor", &SensorFrame::sensor)
      .def_readonly("serial", &SensorFrame::serial)
      .def_readonly("renderer", &SensorFrame::renderer,
                    "The renderer that drew the frame; empty if a sensor measured it.")
      .def_property_readonly("quarter_turns",
                             [](const SensorFrame& frame) {
                               return frame.quarter_turns == kAutoTurns
                                          ? std::optional<int>()
                                          : std::optional<int>(frame.quarter_turns);
                             })
      .def_readonly("ground_truth", &SensorFrame::ground_truth, "(4, 4) float64 or None.")
      .def("__repr__", [](const SensorFrame& frame) {
        return fmt::format("<Frame {}: {}x{} {}>", frame.name, frame.depth.width(),
                           frame.depth.height(), frame.sensor);
      });
}

}  // namespace

std::optional<Structure> NamedCapture::ReadItsStructure() const {
  if (structure || !capture.structure) return structure;
  return ReadStructure(*capture.structure);
}

std::vector<NamedCapture> CapturesOf(const py::handle& object) {
  if (py::isinstance<NamedCapture>(object)) return {object.cast<NamedCapture>()};
  if (IsPath(object)) return {LoadCapture(py::reinterpret_borrow<Path>(object))};
  std::vector<NamedCapture> captures;
  for (const py::handle item : object) {
    if (!py::isinstance<NamedCapture>(item) && !IsPath(item))
      throw py::type_error("a capture is a Capture, a path, or a list of these");
    captures.push_back(CapturesOf(item).front());
  }
  return captures;
}

void AddCapture(py::module_& module) {
  AddFrame(module);
  py::class_<NamedCapture>(module, "Capture",
                           "One frame of each sensor while the stack stood at one place.")
      .def(py::init(&MakeCapture), py::arg("frames"), py::arg("structure") = py::none(),
           py::arg("name") = "",
           "structure: a Structure, the path of one, or None. name: of several captures, for the "
           "result. Raises DataError, and what Structure.load raises.")
      .def_static("load", &LoadCapture, py::arg("path"),
                  "Reads a capture.json with its depth files or recordings. Raises IoError, "
                  "DataError.")
      .def_property_readonly("frames",
                             [](const NamedCapture& capture) {
                               std::vector<std::shared_ptr<SensorFrame>> frames;
                               for (const SensorFrame& frame : capture.capture.sensors)
                                 frames.push_back(std::make_shared<SensorFrame>(frame));
                               return frames;
                             })
      .def_property_readonly("structure", &NamedCapture::ReadItsStructure,
                             "The Structure that it names, or None.")
      .def_property_readonly(
          "name", [](const NamedCapture& capture) { return capture.capture.path.string(); },
          "The file, or the name that it was given.")
      .def("__repr__", [](const NamedCapture& capture) {
        return fmt::format("<Capture {}: {} frames>", capture.capture.path.string(),
                           capture.capture.sensors.size());
      });
}

}  // namespace volalign::python
