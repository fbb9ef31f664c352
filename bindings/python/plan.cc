#include <fmt/format.h>
#include <pybind11/stl.h>

#include <memory>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/work.h"
#include "core/base/error.h"
#include "core/geometry/rig.h"
#include "infer/plan/plan_report.h"

namespace volalign::python {

namespace {

std::shared_ptr<RigPlan> Plan(const py::object& rig, int trials, int threads,
                              const py::kwargs& keywords) {
  if (trials < 1) throw ConfigError(fmt::format("trials = {} violates trials >= 1", trials));
  const Rig first = Turns(ReadRig(SourceOf(rig, keywords))).front();
  CalibrateOptions options;
  options.threads = threads;
  return Working([&] { return std::make_shared<RigPlan>(PlanRig(first, trials, options)); });
}

void AddPlannedSensor(py::module_& module) {
  py::class_<PlannedSensor, std::shared_ptr<PlannedSensor>>(
      module, "PlannedSensor", "The view and the expected accuracy of a planned sensor.")
      .def_readonly("name", &PlannedSensor::name)
      .def_readonly("sensor", &PlannedSensor::sensor)
      .def_readonly("intrinsics", &PlannedSensor::intrinsics)
      .def_readonly("structure_from_sensor", &PlannedSensor::structure_from_sensor,
                    "(4, 4) float64")
      .def_readonly("distance_m", &PlannedSensor::distance_m)
      .def_readonly("sides", &PlannedSensor::sides,
                    "(side, pixels) of the sides in view, the largest first.")
      .def_readonly("sides_fix_pose", &PlannedSensor::sides_fix_pose)
      .def_readonly("in_view", &PlannedSensor::in_view,
                    "Share of the visible surface of the structure that its picture shows.")
      .def_readonly("placed", &PlannedSensor::placed, "In how many of the trials.")
      .def_readonly("expected_m", &PlannedSensor::expected_m,
                    "Root of the mean square of the position's expected error, m.")
      .def_readonly("expected_deg", &PlannedSensor::expected_deg)
      .def_readonly("covariance", &PlannedSensor::covariance,
                    "(6, 6) float64, see SensorResult.covariance; mean over the trials.")
      .def_readonly("weakest", &PlannedSensor::weakest,
                    "(3,) float64: the direction in which its place is known least.")
      .def_readonly("weakest_m", &PlannedSensor::weakest_m, "Standard deviation along it, m.")
      .def_readonly("status", &PlannedSensor::status, "The errors of the worst trial.")
      .def_property_readonly("code", [](const PlannedSensor& s) { return s.finding.code; })
      .def_property_readonly("reason", [](const PlannedSensor& s) { return s.finding.reason; })
      .def_property_readonly("hint", [](const PlannedSensor& s) { return s.finding.hint; });
}

}  // namespace

void AddPlan(py::module_& module) {
  AddPlannedSensor(module);
  py::class_<RigPlan, std::shared_ptr<RigPlan>>(
      module, "Plan", "The expected accuracy of a planned rig; str() is the program's report.")
      .def_readonly("structure", &RigPlan::structure)
      .def_readonly("trials", &RigPlan::trials)
      .def_property_readonly(
          "sensors",
          [](const std::shared_ptr<RigPlan>& plan) { return PartsByName(plan, plan->sensors); },
          "PlannedSensor by name.")
      .def_readonly("pairs", &RigPlan::pairs)
      .def("_repr_svg_", &PlanPicture)
      .def("__str__", &FormatPlan);

  module.def("plan", &Plan, py::arg("rig"), py::kw_only(), py::arg("trials") = 3,
             py::arg("threads") = CalibrateOptions().threads,
             "Predicts what the sensors of a planned rig see and how well they will be "
             "placed.\n\nrig: the path of a rig.yaml, or a dict of its keys; further keywords "
             "stand over it. trials: number of simulated calibrations, each with other errors of "
             "the sensors. If the rig has several turns of the structure, the first one counts. "
             "Raises ConfigError, DataError, IoError.");
}

}  // namespace volalign::python
