#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "cli/table_output.h"
#include "core/base/file_util.h"
#include "core/base/progress_line.h"
#include "core/config/config.h"
#include "core/geometry/rig.h"
#include "infer/plan/plan_report.h"

namespace volalign {

namespace {

struct PlanOptions {
  std::string rig, picture;
  std::vector<std::string> assignments;
  int trials = 3;
  int threads = CalibrateOptions().threads;
  TableOutput table;
};

int RunPlan(const PlanOptions& options) {
  const std::vector<Rig> turns = Turns(ReadRig(ReadSource(options.rig, options.assignments)));
  if (turns.size() > 1)
    options.table.Say(fmt::format("of its {} turns of the structure, the first:", turns.size()));
  CalibrateOptions calibration;
  calibration.threads = options.threads;
  ProgressLine line;
  const RigPlan plan = PlanRig(turns.front(), options.trials, calibration, line.Counter("trials"));
  line.Stop();
  options.table.Print(FormatPlan(plan), PlanTable(plan));
  if (!options.picture.empty()) {
    WriteFileAtomically(options.picture, PlanPicture(plan));
    SaveCommand(options.picture, {{"rig", WriteConfig(turns.front())}});
    options.table.Say("written: " + options.picture);
  }
  const bool all =
      std::all_of(plan.sensors.begin(), plan.sensors.end(),
                  [&](const PlannedSensor& sensor) { return sensor.placed == plan.trials; });
  return all ? 0 : 2;
}

}  // namespace

Command AddPlanCommand(CLI::App& program) {
  auto options = std::make_shared<PlanOptions>();
  CLI::App* app = program.add_subcommand(
      "plan", "Predict what the sensors of a planned rig see and how well they will be placed");
  app->add_option("rig", options->rig, "rig.yaml, e.g. configs/rig_ring8.yaml")->required();
  AddSet(app, &options->assignments, "the rig");
  app->add_option("--trials", options->trials,
                  "number of trials: simulated calibrations, each with other errors of the sensors")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app->add_option("--threads", options->threads, "threads over sensors")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app->add_option("-o,--output", options->picture, "picture of the rig from above, SVG");
  options->table.AddOptions(app);
  return {app, [options] { return RunPlan(*options); }};
}

}  // namespace volalign
