#include "bindings/python/result.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <nlohmann/json.hpp>
#include <optional>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/work.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "infer/report/export.h"
#include "infer/report/report.h"

namespace volalign::python {

namespace {

constexpr double kDegrees = 180 / M_PI;

using Whole = std::shared_ptr<Calibration>;
using SensorPart = std::shared_ptr<FrameResult>;
using CapturePart = std::shared_ptr<CaptureResult>;

struct NamedBox : RefinedBox {
  std::string name;
};

py::dict BoxesOf(const StackResult& stack) {
  py::dict boxes;
  for (std::size_t i = 0; i < stack.boxes.size(); ++i) {
    const std::string& name = stack.built.boxes()[i].name;
    boxes[py::str(name)] = NamedBox{stack.boxes[i], name};
  }
  return boxes;
}

/// A property of a placed sensor; None of a failed one.
template <class Member>
auto IfPlaced(Member FrameResult::*member) {
  return [member](const FrameResult& s) {
    return s.structure_from_sensor ? std::optional<Member>(s.*member) : std::nullopt;
  };
}

void AddSensor(py::module_& module) {
  py::class_<FrameResult, SensorPart>(
      module, "SensorResult",
      "A sensor's outcome. Poses are structure_from_sensor: "
      "p_structure = T p_sensor, m; sensor x right, y down, z forward.")
      .def_readonly("name", &FrameResult::name)
      .def_readonly("status", &FrameResult::status,
                    "\"ok\", \"weak\" (placed, but see code and reason) or \"failed\" (no pose).")
      .def_readonly("code", &FrameResult::code,
                    "Why it is not ok, such as \"no_structure\"; \"\" of one that is.")
      .def_readonly("reason", &FrameResult::reason, "The same as a sentence.")
      .def_readonly("hint", &FrameResult::hint, "Advice on what to do.")
      .def_readonly("structure_from_sensor", &FrameResult::structure_from_sensor,
                    "(4, 4) float64; None of a failed sensor.")
      .def_property_readonly(
          "covariance", IfPlaced<Matrix6d>(&FrameResult::covariance),
          "(6, 6) float64 of d = [translation m; rotation vector rad] in T = Exp(d) T^, structure "
          "frame: a movement about the structure's origin. None of a failed sensor.")
      .def_property_readonly(
          "sigma_position_m", &FrameResult::sigma_position_m,
          "(3,) float64: standard deviations of its position along the structure's axes, m; NaN "
          "of a failed sensor.")
      .def_property_readonly("sigma_rotation_deg", &FrameResult::sigma_rotation_deg,
                             "(3,) float64: of its rotation about them, deg.")
      .def_property_readonly(
          "initial", IfPlaced<Pose>(&FrameResult::initial),
          "(4, 4) float64: the pose before the joint solution; None of a failed sensor.")
      .def_readonly("initial_source", &FrameResult::initial_source,
                    "\"network\", \"geometry\" or \"prior\".")
      .def_readonly(
          "prior", &FrameResult::prior,
          "(4, 4) float64: its prior, in the frame of structure_from_sensor; None without one.")
      .def_readonly("prior_used", &FrameResult::prior_used, "Do the frames not contradict it?")
      .def_readonly(
          "together", &FrameResult::together,
          "(4, 4) float64: of a sensor that disagrees with the others, the pose that they would "
          "give it; else None.")
      .def_readonly("disagrees_with", &FrameResult::disagrees_with)
      .def_readonly("sides", &FrameResult::sides, "Sides that were found and agree.")
      .def_readonly("points", &FrameResult::points, "Pixels with depth and a side's label.")
      .def_readonly("rms_to_structure_m", &FrameResult::rms_to_structure_m)
      .def_readonly("inlier_share", &FrameResult::inlier_share)
      .def_readonly("miou", &FrameResult::miou)
      .def_readonly("explained_share", &FrameResult::explained_share)
      .def_readonly("depth_gain", &FrameResult::depth_gain,
                    "True depth = measured depth * depth_gain + depth_offset_m.")
      .def_readonly("depth_offset_m", &FrameResult::depth_offset_m)
      .def_readonly("quarter_turns", &FrameResult::quarter_turns)
      .def_readonly("intrinsics", &FrameResult::intrinsics, "That the pose belongs to.")
      .def_readonly("intrinsics_given", &FrameResult::intrinsics_given,
                    "The intrinsics of the capture.")
      .def_readonly("error", &FrameResult::error,
                    "(m, deg) against the ground truth; None without one.")
      .def_readonly("initial_error", &FrameResult::initial_error, "The same of `initial`.")
      .def_property_readonly(
          "lens_source", [](const FrameResult& s) { return s.lens.source; },
          "\"given\", \"kind\", \"recognised\" or \"estimated\".")
      .def_property_readonly(
          "labels", [](const SensorPart& s) { return ViewOf(s, s->segmentation.labels); },
          "(H, W) uint8, read-only: found labels, 0 is background. None for a result of several "
          "captures, whose images are in `stills`.")
      .def_property_readonly(
          "confidence", [](const SensorPart& s) { return ViewOf(s, s->segmentation.confidence); },
          "(H, W) float32, read-only: probability of each label; None as `labels`.")
      .def_property_readonly(
          "depth", [](const SensorPart& s) { return ViewOf(s, s->view.depth); },
          "(H, W) float32, read-only: depth as it was used, m; None as `labels`.")
      .def("__repr__", [](const FrameResult& s) {
        return fmt::format("<SensorResult {}: {} {}>", s.name, ToString(s.status),
                           ToString(s.code));
      });
}

void AddStack(py::module_& module) {
  py::class_<PairResult>(module, "Pair", "Two placed sensors.")
      .def_readonly("a", &PairResult::a)
      .def_readonly("b", &PairResult::b)
      .def_readonly("overlap", &PairResult::overlap,
                    "Share of the points that the other one sees too.")
      .def_readonly("rms_m", &PairResult::rms_m,
                    "Distance of the points that both see, m, root mean square; NaN: too few.")
      .def_readonly("predicted_rms_m", &PairResult::predicted_rms_m,
                    "The same as the errors of both depths and of the poses let expect.")
      .def_readonly("covariance", &PairResult::covariance,
                    "(6, 6) float64 of the poses to each other, of d of b less that of a (see "
                    "SensorResult.covariance); NaN where it is not known.")
      .def_readonly("sigma_m", &PairResult::sigma_m,
                    "Standard deviation, m, of where b is as a has it, where that is known least.")
      .def_readonly("sigma_deg", &PairResult::sigma_deg, "The same of how it is turned, deg.");

  py::class_<RigFinding>(module, "Finding", "A reason to doubt a whole calibration.")
      .def_readonly("code", &RigFinding::code,
                    "Such as \"size_off\"; docs/calibration.md lists them.")
      .def_readonly("about", &RigFinding::about,
                    "Names of the sensors or of the box; empty: of all.")
      .def_readonly("reason", &RigFinding::reason, "The observation, in sentences.")
      .def_readonly("hint", &RigFinding::hint, "Advice on what to do.")
      .def("__repr__", [](const RigFinding& finding) {
        return fmt::format("<Finding {}: {}>", ToString(finding.code), finding.reason);
      });

  py::class_<NamedBox>(module, "BoxResult", "A box as it was found, against its nominal place.")
      .def_readonly("name", &NamedBox::name)
      .def_readonly("estimated", &NamedBox::estimated)
      .def_readonly("x_m", &NamedBox::x)
      .def_readonly("z_m", &NamedBox::z)
      .def_property_readonly("yaw_deg", [](const NamedBox& b) { return kDegrees * b.yaw; })
      .def_readonly("sigma_x_m", &NamedBox::sigma_x)
      .def_readonly("sigma_z_m", &NamedBox::sigma_z)
      .def_property_readonly("sigma_yaw_deg",
                             [](const NamedBox& b) { return kDegrees * b.sigma_yaw; });

  py::class_<CaptureResult, CapturePart>(
      module, "StillResult",
      "One of several captures; poses are in the structure where it stood then.")
      .def_readonly("name", &CaptureResult::name)
      .def_readonly("first_from_placement", &CaptureResult::first_from_placement,
                    "(4, 4) float64: where the structure stood, in the structure frame of the "
                    "first.")
      .def_readonly("covariance", &CaptureResult::covariance,
                    "(6, 6) float64, as a sensor's; zero of the first.")
      .def_readonly("built", &CaptureResult::built)
      .def_property_readonly("sensors",
                             [](const CapturePart& s) { return PartsByName(s, s->sensors); })
      .def_property_readonly("boxes", [](const CaptureResult& s) { return BoxesOf(s); });
}

py::object ToDict(const Calibration& calibrated) {
  return FromJson(ExtrinsicsJson(MakeExtrinsics(calibrated), "to_dict").dump());
}

void Save(const Calibration& c, const Path& folder, bool report) {
  const std::string path = PathOf(folder);
  std::optional<ReportRun> run;
  if (report) run = ReportRun{PythonCommand(), c.options};
  RunWork(py::none(), [&](const Tell&) { WriteCalibration(ResultFolder(path), c, run); });
}

void SaveReport(const Calibration& c, const Path& file) {
  const std::string path = PathOf(file);
  const ReportRun run{PythonCommand(), c.options};
  RunWork(py::none(), [&](const Tell&) { WriteReportPage(path, c, run); });
}

}  // namespace

void AddResult(py::module_& module) {
  AddSensor(module);
  AddStack(module);
  py::class_<Calibration, Whole>(module, "Result", "A calibration; str() is the program's report.")
      .def_property_readonly(
          "sensors", [](const Whole& c) { return PartsByName(c, c->result.sensors); },
          "SensorResult by name.")
      .def_property_readonly(
          "verdict", [](const Calibration& c) { return c.result.verdict(); },
          "The worst status of a sensor; with findings, \"weak\" at best.")
      .def_property_readonly(
          "findings", [](const Calibration& c) { return c.result.findings; },
          "List of Finding, the likeliest cause first; empty: nothing makes the whole doubtful.")
      .def_property_readonly(
          "placed", [](const Calibration& c) { return c.result.placed(); },
          "How many sensors have a pose.")
      .def_property_readonly("pairs", [](const Calibration& c) { return c.result.pairs; })
      .def_property_readonly(
          "boxes", [](const Calibration& c) { return BoxesOf(c.result); }, "BoxResult by name.")
      .def_property_readonly(
          "size_scale", [](const Calibration& c) { return c.result.size_scale; },
          "Factor on the size of all boxes.")
      .def_readonly("structure", &Calibration::structure, "As described.")
      .def_property_readonly(
          "built", [](const Calibration& c) { return c.result.built; },
          "The structure with its boxes where the capture shows them.")
      .def_property_readonly(
          "stills",
          [](const Whole& c) {
            std::vector<CapturePart> captures;
            for (CaptureResult& capture : c->result.captures) captures.emplace_back(c, &capture);
            return captures;
          },
          "StillResult of each of several captures; empty of a single one.")
      .def_property_readonly(
          "settled", [](const Calibration& c) { return c.result.solve.settled; },
          "Whether the joint solution came to rest.")
      .def_property_readonly(
          "model",
          [](const Calibration& c) {
            return c.source.model_file.empty() ? std::optional<std::string>()
                                               : std::optional(c.source.model_file);
          },
          "The file of the network that was used; None: geometry alone.")
      .def(
          "set_world",
          [](Calibration& c, const Path& path) {
            c.source.world =
                FindWorldFrame(ReadWorldObservation(PathOf(path)), c.result, c.structure);
          },
          py::arg("path"),
          "Takes the frame of a file of `calibrate --world` (docs/world.md) for `save` and "
          "`convert`. Raises ConfigError, DataError, IoError.")
      .def_property_readonly(
          "world_from_structure",
          [](const Calibration& c) {
            return c.source.world ? std::optional(c.source.world->world_from_structure)
                                  : std::nullopt;
          },
          "(4, 4) float64: where the structure stands in that frame, or None.")
      .def_property(
          "note", [](const Calibration& c) { return c.source.note; },
          [](Calibration& c, const std::string& note) { c.source.note = note; },
          "Anything to remember of it; stands in what save() and report() write.")
      .def_readonly("options", &Calibration::options, "Every option as it was used, YAML.")
      .def_property_readonly(
          "timings_s",
          [](const Calibration& c) {
            py::dict timings;
            for (const auto& [stage, seconds] : c.result.timings_s)
              timings[py::str(stage)] = seconds;
            return timings;
          },
          "Seconds by stage.")
      .def("to_dict", &ToDict, "The content of extrinsics.json.")
      .def("save", &Save, py::arg("folder"), py::arg("report") = true,
           "Writes the folder that `volalign calibrate -o` writes: extrinsics.json, options.yaml, "
           "labels, confidence, pictures, clouds and, with `report`, report.html and rig.glb. "
           "Raises IoError.")
      .def("report", &SaveReport, py::arg("path"), "Writes report.html alone. Raises IoError.")
      .def("__str__", [](const Calibration& c) { return FormatReport(c.result); })
      .def("__repr__", [](const Calibration& c) {
        return fmt::format("<Result {}: {} of {} sensors placed>", ToString(c.result.verdict()),
                           c.result.placed(), c.result.sensors.size());
      });
}

}  // namespace volalign::python
