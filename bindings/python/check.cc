#include <fmt/format.h>
#include <pybind11/stl.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/result.h"
#include "infer/rigcheck/rig_check.h"

namespace volalign::python {

namespace {

/// A check with the calibrations that it compares.
struct Checked {
  Extrinsics last, now;
  std::shared_ptr<Calibration> result;
  RigCheck check;
};

std::shared_ptr<Checked> Check(const py::object& last, const py::object& capture,
                               double false_alarm, std::vector<std::string> moved,
                               bool one_may_stay, const py::object& structure,
                               const py::object& model, const py::object& options,
                               const py::object& progress, const py::kwargs& keywords) {
  auto checked = std::make_shared<Checked>();
  std::string last_file = "last";
  if (py::isinstance<Calibration>(last)) {
    checked->last = MakeExtrinsics(last.cast<const Calibration&>());
  } else {
    last_file = PathOf(last);
    checked->last = ReadExtrinsics(last_file);
  }
  checked->result =
      py::isinstance<Calibration>(capture)
          ? capture.cast<std::shared_ptr<Calibration>>()
          : CalibrateCapture({capture, structure, model, options, progress, keywords});
  checked->now = MakeExtrinsics(*checked->result);
  MovementOptions movement;
  movement.false_alarm = false_alarm;
  movement.moved = std::move(moved);
  movement.one_may_stay = one_may_stay;
  checked->check = CheckRig(last_file, checked->last, checked->now, movement);
  return checked;
}

void AddMovement(py::module_& module) {
  py::class_<SensorMovement, std::shared_ptr<SensorMovement>>(
      module, "Movement", "A sensor's two poses, in the last structure frame.")
      .def_readonly("name", &SensorMovement::name)
      .def_readonly("movement", &SensorMovement::movement,
                    "\"stayed\", \"moved\" or \"undecided\".")
      .def_readonly("translation_m", &SensorMovement::translation_m)
      .def_readonly("rotation_deg", &SensorMovement::rotation_deg)
      .def_readonly("probability", &SensorMovement::probability,
                    "Probability of so large a difference without any movement.")
      .def_readonly("found_from_m", &SensorMovement::found_from_m,
                    "A movement is found with 95 % probability from this size on, m.")
      .def_readonly("found_from_deg", &SensorMovement::found_from_deg)
      .def_readonly("structure_from_sensor", &SensorMovement::structure_from_sensor,
                    "(4, 4) float64: where it stands now.")
      .def_readonly("covariance", &SensorMovement::covariance,
                    "(6, 6) float64, see SensorResult.covariance.");
}

std::vector<std::string> MovedOf(const Checked& checked) {
  std::vector<std::string> moved;
  for (const SensorMovement& sensor : checked.check.movements.sensors) {
    if (sensor.movement == Movement::kMoved) moved.push_back(sensor.name);
  }
  return moved;
}

}  // namespace

void AddCheck(py::module_& module) {
  AddMovement(module);
  py::class_<Checked, std::shared_ptr<Checked>>(
      module, "Check", "The sensors that moved since a calibration; str() is the program's report.")
      .def_property_readonly(
          "sensors",
          [](const std::shared_ptr<Checked>& checked) {
            return PartsByName(checked, checked->check.movements.sensors);
          },
          "Movement by name.")
      .def_property_readonly("moved", &MovedOf, "Names of the sensors that have moved.")
      .def_property_readonly(
          "not_compared",
          [](const Checked& checked) {
            py::dict reasons;
            for (const RigCheck::NotCompared& sensor : checked.check.not_compared)
              reasons[py::str(sensor.name)] = sensor.reason;
            return reasons;
          },
          "Reasons by name, of sensors that have not two poses.")
      .def_property_readonly(
          "exchanged",
          [](const Checked& checked) {
            py::dict places;
            for (const Exchanged& sensor : checked.check.exchanged)
              places[py::str(sensor.name)] = sensor.place_of;
            return places;
          },
          "Sensors that have exchanged their places or their depth files: by name, the sensor in "
          "whose place it stands.")
      .def_property_readonly("same_structure",
                             [](const Checked& checked) { return checked.check.same_structure; })
      .def_property_readonly(
          "last_from_now",
          [](const Checked& checked) { return checked.check.movements.last_from_now; },
          "(4, 4) float64: where the structure stands now in the last structure frame; None where "
          "it is not known which sensors stayed.")
      .def_property_readonly(
          "result", [](const Checked& checked) { return checked.result; },
          "Result of the new capture.")
      .def(
          "moved_beyond",
          [](const Checked& checked, double translation_m, double rotation_deg) {
            return checked.check.MovedBeyond(translation_m, rotation_deg);
          },
          py::arg("translation_m"), py::arg("rotation_deg"),
          "Whether a sensor has moved by more than these.")
      .def(
          "to_dict",
          [](const Checked& checked) { return FromJson(RigCheckText(checked.check, "to_dict")); },
          "The content of check.json.")
      .def(
          "save",
          [](const Checked& checked, const Path& path) {
            WriteRigCheck(PathOf(path), checked.check);
          },
          py::arg("path"), "Writes check.json. Raises IoError.")
      .def(
          "update",
          [](const Checked& checked, const Path& path) {
            WriteExtrinsics(PathOf(path),
                            UpdateExtrinsics(checked.last, checked.now, checked.check));
          },
          py::arg("path"),
          "Writes an extrinsics.json with new poses of the sensors that moved, in the last "
          "structure frame. The others keep their poses. Raises DataError if it is undecided which "
          "sensors moved.")
      .def("__str__", [](const Checked& checked) { return FormatRigCheck(checked.check); });

  module.def("check", &Check, py::arg("last"), py::arg("capture"), py::kw_only(),
             py::arg("false_alarm") = MovementOptions().false_alarm,
             py::arg("moved") = std::vector<std::string>(), py::arg("one_may_stay") = false,
             py::arg("structure") = py::none(), py::arg("model") = "auto",
             py::arg("options") = py::none(), py::arg("progress") = py::none(),
             "Which sensors of a calibrated rig were moved since?\n\n\nlast: the path of an "
             "extrinsics.json, or a Result.\ncapture: a capture of the rig as it is now, as in "
             "`calibrate`, or the Result of one. The stack may stand elsewhere.\nfalse_alarm: "
             "probability that a sensor that stayed is reported as moved.\nmoved: names of sensors "
             "that were moved or replaced.\none_may_stay: trusts a single other sensor, as "
             "`volalign add` does. The rest as in `calibrate`. Raises ConfigError, DataError, "
             "IoError.");
}

}  // namespace volalign::python
