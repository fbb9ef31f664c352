#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/camera.h"
#include "core/nn/checkpoint.h"
#include "train/log/metrics.h"
#include "train/log/run_folder.h"
#include "train/train_config.h"
#include "train/train_state.h"
#include "train/training_data.h"

namespace volalign {

inline constexpr char kStateFormat[] = "volalign.training/3";

/// Progress of a run, beside its weights.
struct RunProgress {
  std::int64_t samples = 0;       ///< drawn so far
  std::int64_t init_samples = 0;  ///< training samples of run.init
  double lr = 0;                  ///< of the last step
  /// Least and largest focal length so far, px, and the image sizes so far.
  std::pair<double, double> focal_px{0, 0};
  std::set<std::pair<int, int>> image_sizes;
  std::int64_t validated = -1;  ///< samples at the last validation; -1: none yet
  BestValidation best;
  StepMeans means;  ///< the steps since the last row of the log

  void NoteCameras(const std::vector<Intrinsics>& cameras);
};

/// Convert to text and back. ReadProgress throws DataError for any other text.
std::string WriteProgress(const RunProgress& progress);
RunProgress ReadProgress(const std::string& text);

/// Writes all that a run needs to continue: `state`, `progress`, and the identity of the run
/// (`config` and TrainingData::identity). Throws IoError.
void SaveState(const std::filesystem::path& path, const TrainConfig& config,
               const std::string& data_identity, const Compute& compute, TrainState& state,
               const RunProgress& progress);

/// Throws ConfigError if `config` differs from `saved_yaml`, the configuration of the state `path`,
/// in a key that changes a sample or a step. Other keys may differ if a run is resumed.
void RequireSameRun(const std::string& saved_yaml, const TrainConfig& config,
                    const std::string& path);

/// Are the results of validations under both configurations comparable?
bool SameValidation(const std::string& saved_yaml, const TrainConfig& config);

/// Content of a state's file beside its tensors.
struct StateMeta {
  RunProgress progress;
  std::int64_t steps = 0;
  std::string data_identity;
  bool bf16 = false;           ///< the type of the run's computation, else float32
  bool channels_last = false;  ///< the run's layout, whatever the machine
  std::string config;
};

/// A state that was read, of the run that the caller wants to continue.
struct SavedState : StateMeta {
  std::filesystem::path path;
  TensorFile file;
};

/// The newest state of `folder` that is whole, or nothing if there is no state. `damaged` receives
/// a sentence for each newer one that is damaged. Throws ConfigError for the state of a run with
/// another configuration (RequireSameRun) or other samples, DataError if every state is damaged.
std::optional<SavedState> FindState(const RunFolder& folder, const TrainConfig& config,
                                    const std::string& data_identity,
                                    std::vector<std::string>* damaged);

/// Restores weights, average and optimiser. Throws DataError if the state lacks one.
void Restore(const SavedState& saved, TrainState* state);

/// Writes the deployable checkpoint (core/nn/checkpoint.h) of the averaged weights. Throws IoError.
void SaveModel(const std::filesystem::path& path, const TrainConfig& config,
               const TrainingData& data, TrainState& state, const RunProgress& progress);

}  // namespace volalign
