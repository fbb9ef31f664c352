#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "train/log/event_file.h"
#include "train/log/sinks.h"

namespace volalign {

/// Event files for TensorBoard. Its steps are samples, so that runs of different batch sizes
/// compare.
class TensorBoardSink : public MetricSink {
 public:
  /// A run that has `samples` samples behind it; what was written of later ones will come again.
  TensorBoardSink(const std::filesystem::path& folder, const std::string& config_yaml,
                  std::int64_t samples);
  void Train(const TrainRow& row) override;
  void Validation(const ValidationRow& row) override;

 private:
  EventFile file_;
};

/// Depth, labels and predicted labels of some samples, a row each.
RgbImage LabelPictures(const std::vector<LabelExample>& examples);

}  // namespace volalign
