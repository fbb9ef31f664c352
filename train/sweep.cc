#include "train/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/interrupt.h"
#include "core/nn/cpu/torch_threads.h"
#include "train/run_inputs.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

struct SweepFile {
  std::vector<std::string> recipes, over, seeds;
  nlohmann::json set = nlohmann::json::object();

  template <class Archive>
  void Describe(Archive& ar) {
    ar("recipes", recipes, "the files of recipes", Required());
    ar("over", over, "files of keys that all runs share");
    ar("set", set, "keys of recipes, each with a value or with a list of those to try");
    ar("seeds", seeds, "values of run.seed to try");
  }
};

/// A value as part of a folder's name.
std::string InName(const std::string& text) {
  std::string name;
  for (const char c : text) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.' || c == '-';
    if (plain) name += c;
  }
  return name;
}

/// All combinations of one value per key; the last key changes fastest.
std::vector<std::vector<std::string>> Combinations(const std::vector<SweepKey>& keys) {
  std::vector<std::vector<std::string>> all = {{}};
  for (const SweepKey& key : keys) {
    std::vector<std::vector<std::string>> longer;
    for (const auto& so_far : all) {
      for (const std::string& value : key.values) {
        longer.push_back(so_far);
        longer.back().push_back(value);
      }
    }
    all = longer;
  }
  return all;
}

void RequireDifferentNames(const std::vector<SweepRun>& runs) {
  std::set<std::string> names;
  for (const SweepRun& run : runs) {
    if (names.insert(run.name).second) continue;
    throw ConfigError(
        fmt::format("two runs of the sweep would have the folder {}: give their recipes other "
                    "names, or take out a value that is listed twice",
                    run.name));
  }
}

/// Throws if a listed key is set for all runs: their names would say other values.
void RequireNotListed(const Sweep& sweep, const std::string& key) {
  for (const SweepKey& of : sweep.keys) {
    if (of.listed && of.key == key)
      throw ConfigError(fmt::format("{}: the sweep has several values of it", key));
  }
}

}  // namespace

Sweep ReadSweep(const ConfigSource& source) {
  const auto file = ReadConfig<SweepFile>(source);
  for (const auto& [key, leaf] : source.Leaves()) {
    if (LeafTexts(leaf).empty())
      throw ConfigError(fmt::format("{}: {} is empty", source.WhereOf(key), key));
  }
  Sweep sweep{file.recipes, {}};
  for (const std::string& over : file.over) {
    for (const auto& [key, leaf] : ConfigSource::FromFile(over).Leaves())
      sweep.keys.push_back({key, {FlowText(leaf)}, false});
  }
  for (const auto& [key, leaf] : LeavesOf(file.set))
    sweep.keys.push_back({key, LeafTexts(leaf), leaf.is_array()});
  if (!file.seeds.empty()) sweep.keys.push_back({"run.seed", file.seeds});
  return sweep;
}

std::vector<SweepRun> ExpandSweep(const Sweep& sweep, const std::vector<std::string>& assignments) {
  std::vector<SweepRun> runs;
  for (const std::string& recipe : sweep.recipes) {
    for (const std::vector<std::string>& values : Combinations(sweep.keys)) {
      ConfigSource source = ConfigSource::FromFile(recipe);
      SweepRun run;
      run.name = fs::path(recipe).stem().string();
      for (std::size_t i = 0; i < values.size(); ++i) {
        const SweepKey& key = sweep.keys[i];
        source.Set(key.key + "=" + values[i]);
        if (key.listed) run.name += fmt::format("_{}={}", key.key, InName(values[i]));
      }
      for (const std::string& assignment : assignments) {
        RequireNotListed(sweep, assignment.substr(0, assignment.find('=')));
        source.Set(assignment);
      }
      run.config = ReadTrainConfig(source);
      runs.push_back(std::move(run));
    }
  }
  RequireDifferentNames(runs);
  return runs;
}

SweepResult TrainSweep(const std::vector<SweepRun>& runs, const std::string& dir, bool quiet) {
  const InterruptGuard guard;
  SweepResult result;
  for (const SweepRun& run : runs) {
    result.signal = guard.Signal();
    if (result.signal != 0) return result;
    if (!quiet) fmt::print(stderr, "{}\n", run.name);
    TrainConfig config = run.config;
    TrainOptions options;
    options.run_dir = fs::path(dir) / run.name;
    options.resume = fs::exists(options.run_dir / "config.yaml");
    options.quiet = quiet;
    if (options.resume) UseKeptInputs(options.run_dir, &config.data);
    SetTorchThreads(config.run.threads);
    try {
      const TrainResult trained = Train(config, options);
      result.signal = trained.signal;
      if (!trained.finished) return result;
    } catch (const Error& e) {
      result.failures.push_back(fmt::format("{}: {}", run.name, e.what()));
      if (!quiet) fmt::print(stderr, "error: {}\n", result.failures.back());
    }
  }
  result.finished = true;
  return result;
}

}  // namespace volalign
