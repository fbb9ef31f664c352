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

/// The groups with the keys to be shown; says how many others differ.
std::vector<RunGroup> Shown(std::vector<RunGroup> groups, const RunsOptions& options) {
  const std::size_t left_out = ShowKeys(options.keys, &groups);
  if (left_out > 0 && options.keys.empty())
    fmt::print(stderr, "{} more keys differ: choose with --keys KEY,KEY\n", left_out);
  return groups;
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
      "and standard deviation of the metrics over its seeds. Differences are from the first row",
      options.get());
  options->table.AddOptions(compare);
  compare
      ->add_option("--keys", options->keys,
                   "keys of the recipes that tell the runs apart, e.g. model.attention,optim.lr; "
                   "without it, the five that differ most")
      ->delimiter(',');
  return {app, [options, list] {
            const std::vector<LoggedRun> runs = ReadThem(*options);
            if (*list) {
              const Table table = ListRuns(runs);
              options->table.Print(FormatTable(table, TableFormat::kText), table);
              return 0;
            }
            // People get few keys, programs all of them, unless some were asked for.
            const std::vector<RunGroup> groups = GroupRuns(runs), shown = Shown(groups, *options);
            options->table.Print(FormatTable(CompareRuns(shown), TableFormat::kText),
                                 CompareRuns(options->keys.empty() ? groups : shown));
            return 0;
          }};
}

}  // namespace volalign
