#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "train/log/event_file.h"
#include "train/log/sinks.h"

namespace volalign {

/// Event files for TensorBoard. Its steps are samples, so that runs of different batch sizes can be
/// compared.
class TensorBoardSink : public MetricSink {
 public:
  /// `samples`: samples of the run so far. Earlier events of later samples are void, as they come
  /// again.
  TensorBoardSink(const std::filesystem::path& folder, const std::string& config_yaml,
                  std::int64_t samples);
  void Train(const TrainRow& row) override;
  void Validation(const ValidationRow& row) override;

 private:
  EventFile file_;
};

/// Depth, labels and predicted labels of some samples, one row per sample.
RgbImage LabelPictures(const std::vector<LabelExample>& examples);

}  // namespace volalign
