#pragma once

#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/structure.h"
#include "render/sample.h"
#include "train/learner.h"
#include "train/train_config.h"

namespace volalign {

inline constexpr char kStateFormat[] = "volalign.training/1";

/// How far a run is, beside its weights.
struct RunProgress {
  std::int64_t samples = 0;       ///< drawn so far
  std::int64_t init_samples = 0;  ///< that run.init was trained on
  double lr = 0;                  ///< of the last step
  /// Least and largest focal length, px, and the image sizes that were seen.
  std::pair<double, double> focal_px{0, 0};
  std::set<std::pair<int, int>> image_sizes;

  void NoteCameras(const std::vector<Sample>& drawn);
};

/// Writes all that a run needs to go on: `learner`, `progress`, and what tells whether another run
/// is the same one (`config`, and TrainingData::identity). Throws IoError.
void SaveState(const std::filesystem::path& path, const TrainConfig& config,
               const std::string& data_identity, Learner& learner, const RunProgress& progress);

/// Restores it. Throws IoError, DataError for a damaged file, ConfigError for the state of a run
/// with another configuration (RequireSameRun) or other samples.
RunProgress LoadState(const std::filesystem::path& path, const TrainConfig& config,
                      const std::string& data_identity, Learner* learner);

/// Writes the deployable checkpoint (core/checkpoint.h) of the averaged weights. Throws IoError.
void SaveModel(const std::filesystem::path& path, const TrainConfig& config,
               const Structure& structure, Learner& learner, const RunProgress& progress);

}  // namespace volalign
