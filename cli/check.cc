#include <fmt/format.h>

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

constexpr int kMovedStatus = 3, kNotComparedStatus = 2;

struct CheckOptions {
  std::string last, update;
  double max_mm = 0, max_deg = 0;
  CalibrationRequest request;
  MovementOptions movement;
};

void AddCheckOptions(CLI::App* app, CheckOptions* options) {
  app->add_option("--extrinsics", options->last, "extrinsics.json of the last calibration")
      ->required();
  app->add_option("--capture", options->request.captures,
                  "capture.json of the rig as it is now; the stack may stand elsewhere than last "
                  "time. Several, where the stack was moved between them")
      ->required();
  AddCalibrationOptions(app, &options->request);
  app->add_option("--max-mm", options->max_mm,
                  "exit status 3 if a sensor moved by more than this, mm")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_option("--max-deg", options->max_deg,
                  "exit status 3 if a sensor turned by more than this, deg")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_option("--update", options->update,
                  "write an extrinsics.json with new poses of the sensors that moved, in the "
                  "structure frame of the last calibration. The others keep their poses");
  app->add_option(
         "--false-alarm", options->movement.false_alarm,
         "probability that a sensor that stayed is reported as moved, if errors are normal")
      ->check(CLI::Range(1e-12, 0.1))
      ->capture_default_str();
  app->add_option("-o,--output", options->request.output,
                  "folder for check.json and for the files of `calibrate` for the new capture");
}

int RunCheck(const CheckOptions& options) {
  const Extrinsics last = ReadExtrinsics(options.last);
  CalibrationRequest request = options.request;
  request.last_structure = last.structure;
  Extrinsics now_extrinsics;
  RigCheck check;
  const Calibration now =
      RunCalibration(request, [&](const Calibration& calibration, ReportRun* report) {
        now_extrinsics = MakeExtrinsics(calibration.result, calibration.stills,
                                        calibration.structure, calibration.source);
        check = CheckRig(options.last, last, now_extrinsics, options.movement);
        report->check = RigCheckText(check, "check.json");
        report->checked = RigCheckSentences(check);
      });
  const TableOutput& table = options.request.table;
  table.Print(FormatRigCheck(check), MovementTable(check.movements));
  if (!options.request.output.empty()) {
    WriteRigCheck(std::filesystem::path(options.request.output) / "check.json", check);
    table.Say(fmt::format("written: {}, check.json", WrittenBy(options.request, now)));
  }
  if (!options.update.empty()) {
    WriteExtrinsics(options.update, UpdateExtrinsics(last, now_extrinsics, check));
    SaveCommand(options.update, {{"calibration", now.options}});
    table.Say("written: " + options.update);
  }
  if (check.MovedBeyond(0.001 * options.max_mm, options.max_deg)) return kMovedStatus;
  return check.not_compared.empty() ? 0 : kNotComparedStatus;
}

}  // namespace

Command AddCheckCommand(CLI::App& program) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* app = program.add_subcommand(
      "check", "Find out which sensors of a calibrated rig were moved since, by a new capture");
  AddCheckOptions(app, options.get());
  return {app, [options] { return RunCheck(*options); }};
}

}  // namespace volalign
