#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "cli/calibration.h"
#include "cli/command_line.h"
#include "cli/commands.h"
#include "infer/report/extrinsics.h"
#include "infer/rigcheck/movement_table.h"
#include "infer/rigcheck/rig_check.h"

namespace volalign {

namespace {

/// Exit statuses: a sensor moved; a sensor has no pose to compare or to write.
constexpr int kMovedStatus = 3, kIncompleteStatus = 2;

/// A calibration, and a capture of the same rig as it is now.
struct Comparison {
  std::string last;
  CalibrationRequest request;
  MovementOptions movement;
};

void AddComparison(CLI::App* app, Comparison* comparison) {
  app->add_option("--extrinsics", comparison->last, "extrinsics.json of the last calibration")
      ->required();
  app->add_option("--capture", comparison->request.captures,
                  "capture.json of the rig as it is now; the stack may stand elsewhere than last "
                  "time. Several, where the stack was moved between them")
      ->required();
  AddCalibrationOptions(app, &comparison->request);
  app->add_option(
         "--false-alarm", comparison->movement.false_alarm,
         "probability that a sensor that stayed is reported as moved, if errors are normal")
      ->check(CLI::Range(1e-12, 0.1))
      ->capture_default_str();
}

struct Compared {
  Extrinsics last, now;
  RigCheck check;
  std::string options;  ///< of the calibration, YAML
};

/// Calibrates the capture, compares, and prints the table. Writes CalibrationRequest::output.
Compared Compare(Comparison comparison) {
  CalibrationRequest& request = comparison.request;
  Compared out;
  out.last = ReadExtrinsics(comparison.last);
  request.last_structure = out.last.structure;
  const WrittenCalibration now =
      RunCalibration(request, [&](const Calibration& calibration, ReportRun* report) {
        out.now = MakeExtrinsics(calibration);
        out.check = CheckRig(comparison.last, out.last, out.now, comparison.movement);
        report->check = RigCheckText(out.check, "check.json");
        report->checked = RigCheckSentences(out.check);
      });
  out.options = now.options;
  request.table.Print(FormatRigCheck(out.check), MovementTable(out.check.movements));
  if (!request.output.empty()) {
    WriteRigCheck(std::filesystem::path(request.output) / "check.json", out.check);
    request.table.Say(fmt::format("written: {}, check.json", now.written));
  }
  return out;
}

}  // namespace

Command AddCheckCommand(CLI::App& program) {
  struct Options : Comparison {
    double max_mm = 0, max_deg = 0;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app = program.add_subcommand(
      "check", "Find out which sensors of a calibrated rig were moved since, by a new capture");
  AddComparison(app, options.get());
  app->add_option("--max-mm", options->max_mm,
                  "exit status 3 if a sensor moved by more than this, mm")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_option("--max-deg", options->max_deg,
                  "exit status 3 if a sensor turned by more than this, deg")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_option_function<std::string>("--update",
                                        [](const std::string&) {
                                          throw CLI::ValidationError(
                                              "--update", "`volalign add` does this now");
                                        })
      ->group("");
  app->add_option("-o,--output", options->request.output,
                  "folder for check.json and for the files of `calibrate` for the new capture");
  return {app, [options] {
            const RigCheck check = Compare(*options).check;
            if (check.MovedBeyond(0.001 * options->max_mm, options->max_deg)) return kMovedStatus;
            return check.not_compared.empty() ? 0 : kIncompleteStatus;
          }};
}

Command AddAddCommand(CLI::App& program) {
  struct Options : Comparison {
    std::string output;
  };
  auto options = std::make_shared<Options>();
  options->movement.one_may_stay = true;
  CLI::App* app = program.add_subcommand(
      "add",
      "Give new, replaced or moved sensors of a calibrated rig their poses, by a new capture");
  AddComparison(app, options.get());
  app->add_option("--moved", options->movement.moved,
                  "names of sensors that were moved or replaced. Those that are not named are "
                  "tested; a single one is trusted")
      ->take_all();
  app->add_option(
         "-o,--output", options->output,
         "file to write: extrinsics.json of the whole rig, in the structure frame of the last "
         "calibration. New and moved sensors have new poses; the others keep theirs")
      ->required();
  app->add_option("--calibration", options->request.output,
                  "keeps check.json and the calibration of the new capture in this folder");
  return {app, [options] {
            const Compared found = Compare(*options);
            const Extrinsics rig = UpdateExtrinsics(found.last, found.now, found.check);
            WriteExtrinsics(options->output, rig);
            SaveCommand(options->output, {{"calibration", found.options}});
            const TableOutput& table = options->request.table;
            table.Say(UpdateSentence(found.last, found.now, found.check));
            table.Say("written: " + options->output);
            const bool placed = std::all_of(
                found.now.sensors.begin(), found.now.sensors.end(),
                [](const Extrinsics::Sensor& sensor) { return sensor.structure_from_sensor; });
            return placed ? 0 : kIncompleteStatus;
          }};
}

}  // namespace volalign
