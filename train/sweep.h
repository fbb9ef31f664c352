#pragma once

#include <string>
#include <vector>

#include "core/config/config.h"
#include "train/train_config.h"
#include "train/trainer.h"

namespace volalign {

/// A key with the values that it takes in turn.
struct SweepKey {
  std::string key;
  std::vector<std::string> values;
  bool listed = true;  ///< false: one value for all runs, not in the names of folders
};

/// Runs of every recipe with every combination of values and every seed (docs/training.md):
///   recipes: [configs/m04.yaml, configs/m05.yaml]
///   over: configs/lite.yaml
///   set: {model.base_channels: 8, optim.lr: [1e-4, 2e-4]}
///   seeds: [1, 2, 3]
struct Sweep {
  std::vector<std::string> recipes;
  std::vector<SweepKey> keys;  ///< the seeds, if any, come last
};

/// Throws ConfigError for an unknown key of a sweep, or no recipe.
Sweep ReadSweep(const ConfigSource& source);

struct SweepRun {
  std::string name;  ///< of the folder: the recipe, and a value per listed key
  TrainConfig config;
};

/// The runs in order: recipes, then values, then seeds. `assignments` are set over all of them.
/// Throws as reading a recipe does.
std::vector<SweepRun> ExpandSweep(const Sweep& sweep, const std::vector<std::string>& assignments);

struct SweepResult {
  bool finished = false;              ///< false: interrupted, can be called again
  int signal = 0;                     ///< the signal that interrupted it; 0: none
  std::vector<std::string> failures;  ///< "NAME: message" of runs that ended with an error
};

/// Trains the runs one after the other in folders of `dir`. A run that was begun is resumed; a
/// finished one is left unchanged. If a run fails, its error is noted, and the others go on. SIGINT
/// and SIGTERM stop the current run, and no other begins.
SweepResult TrainSweep(const std::vector<SweepRun>& runs, const std::string& dir, bool quiet);

}  // namespace volalign
