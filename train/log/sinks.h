#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "core/base/progress_line.h"
#include "train/log/event_file.h"
#include "train/log/metrics.h"

namespace volalign {

/// A receiver of a run's numbers during training.
class MetricSink {
 public:
  virtual ~MetricSink() = default;
  virtual void Train(const TrainRow& row) = 0;
  virtual void Validation(const ValidationRow& row) = 0;
};

/// One JSON object per line (docs/formats.md).
class JsonlSink : public MetricSink {
 public:
  /// Continues a file: keeps its rows up to `samples`. Drops the rows that a killed run wrote after
  /// its last state, which come again. Throws IoError.
  JsonlSink(const std::filesystem::path& path, std::int64_t samples);
  void Train(const TrainRow& row) override;
  void Validation(const ValidationRow& row) override;

 private:
  void Write(const std::string& row);

  std::string path_;
  std::ofstream file_;
};

/// Progress on stderr: a ProgressLine on a terminal, lines elsewhere.
class ProgressSink : public MetricSink {
 public:
  /// `total`: samples of the run.
  explicit ProgressSink(std::int64_t total) : total_(total) { line_.Begin("training"); }
  void Train(const TrainRow& row) override;
  void Validation(const ValidationRow& row) override;
  void Line(const std::string& text);
  /// The progress of a validation.
  CountDone Counter() { return line_.Counter("validation"); }

 private:
  std::int64_t total_;
  std::string miou_;  ///< of the last validation, ready to print
  ProgressLine line_;
};

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
