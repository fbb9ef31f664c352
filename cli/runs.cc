#include "cli/commands.h"

#include <fmt/format.h>

#include <memory>
#include <string>
#include <vector>

#include "cli/command_line.h"
#include "cli/table_output.h"
#include "train/log/run_log.h"

namespace volalign {

namespace {

struct RunsOptions {
  std::vector<std::string> folders, keys;
  TableOutput table;
};

CLI::App* AddVerb(CLI::App* app, const char* name, const char* text, RunsOptions* options) {
  CLI::App* verb = app->add_subcommand(name, text);
  verb->add_option("folders", options->folders, "run folders, or folders that hold such")
      ->required();
  return verb;
}

/// Reads the runs and names skipped folders on standard error.
std::vector<LoggedRun> ReadThem(const RunsOptions& options) {
  std::vector<std::string> passed_over;
  std::vector<LoggedRun> runs = ReadRuns(options.folders, &passed_over);
  for (const std::string& folder : passed_over) fmt::print(stderr, "passed over: {}\n", folder);
  return runs;
}

}  // namespace

Command AddRunsCommand(CLI::App& program) {
  auto options = std::make_shared<RunsOptions>();
  CLI::App* app = program.add_subcommand("runs", "List and compare training runs");
  app->require_subcommand(1);
  CLI::App* list = AddVerb(
      app, "list", "One row per run: how far it is, its last metrics, its speed", options.get());
  options->table.AddOptions(list);
  CLI::App* compare = AddVerb(
      app, "compare",
      "One row per configuration: the folder of its first run, the keys that differ, and the mean "
      "and standard deviation of the metrics over its seeds",
      options.get());
  options->table.AddOptions(compare);
  compare
      ->add_option("--keys", options->keys,
                   "keys of the recipes to show, e.g. model.attention,optim.lr; without it, all "
                   "that differ")
      ->delimiter(',');
  return {app, [options, list] {
            const std::vector<LoggedRun> runs = ReadThem(*options);
            std::vector<RunGroup> groups = GroupRuns(runs);
            if (!options->keys.empty()) ShowKeys(options->keys, &groups);
            const Table table = *list ? ListRuns(runs) : CompareRuns(groups);
            options->table.Print(FormatTable(table, TableFormat::kText), table);
            return 0;
          }};
}

}  // namespace volalign
