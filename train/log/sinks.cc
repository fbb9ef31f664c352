#include "train/log/sinks.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/plot/picture.h"

namespace volalign {

using nlohmann::json;

namespace {

json RowOf(const TrainRow& row) {
  const StepReport& mean = row.mean;
  json j = {{"type", "train"},
            {"step", row.step},
            {"samples", row.samples},
            {"loss", mean.loss},
            {"degenerate", mean.degenerate_samples},
            {"gradient_norm", mean.gradient_norm},
            {"skipped", mean.skipped},
            {"lr", row.lr},
            {"samples_per_s", row.samples_per_s}};
  for (const auto& [name, part] : kStepParts) j["step_s"][name] = mean.times.*part;
  for (const auto& [name, value] : mean.terms) j[name] = value;
  return j;
}

json RowOf(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  json j = {{"type", "validation"},
            {"step", row.step},
            {"samples", row.samples},
            {"validation_samples", v.samples},
            {"posed", v.samples_with_pose}};
  for (const auto& [name, value] : v.means) j[name] = value;
  return j;
}

/// The numbers of a row by TensorBoard's tags, such as train/loss and train/step_s/data.
std::vector<std::pair<std::string, double>> ScalarsOf(const json& row) {
  std::vector<std::pair<std::string, double>> scalars;
  const json flat = row.flatten();
  for (const auto& [path, value] : flat.items())
    if (value.is_number()) scalars.emplace_back(row["type"].get<std::string>() + path, value);
  return scalars;
}

}  // namespace

JsonlSink::JsonlSink(const std::filesystem::path& path, std::int64_t samples)
    : path_(path.string()) {
  std::string kept;
  if (samples > 0 && std::filesystem::exists(path)) {
    std::istringstream rows(ReadFile(path, kMaxLogBytes));
    for (std::string row; std::getline(rows, row);) {
      const json j = json::parse(row, nullptr, /*allow_exceptions=*/false);
      if (!j.is_object()) continue;
      const json at = j.value("samples", json(0));
      if (at.is_number_integer() && at.get<std::int64_t>() <= samples) kept += row + "\n";
    }
  }
  WriteFileAtomically(path, kept);
  file_.open(path, std::ios::app);
  if (!file_) throw IoError(fmt::format("{}: cannot be written", path_));
}

void JsonlSink::Write(const std::string& row) {
  file_ << row << "\n" << std::flush;
  if (!file_) throw IoError(fmt::format("{}: writing failed: is the disk full?", path_));
}

void JsonlSink::Train(const TrainRow& row) { Write(RowOf(row).dump()); }

void JsonlSink::Validation(const ValidationRow& row) { Write(RowOf(row).dump()); }

void ProgressSink::Train(const TrainRow& row) {
  const std::string text = fmt::format("loss {:.4f}{}  {:.1f} samples/s  lr {:.2e}", row.mean.loss,
                                       miou_, row.samples_per_s, row.lr);
  if (line_.shown()) {
    line_.Count("training", row.samples, total_, text);
  } else {
    const auto left = static_cast<double>(total_ - row.samples);
    Line(fmt::format("{:5.1f} %  {}/{}  {}  about {} left",
                     100 * static_cast<double>(row.samples) / static_cast<double>(total_),
                     row.samples, total_, text,
                     RoundDuration(left / std::max(row.samples_per_s, 1e-9))));
  }
  if (row.mean.skipped > 0) {
    Line(fmt::format("warning: {} of {} steps were skipped: their loss or gradient was not finite",
                     row.mean.skipped, row.mean.steps));
  }
}

void ProgressSink::Validation(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  miou_ = fmt::format("  mIoU {:.3f}", v.Mean("miou"));
  Line(
      fmt::format("validation at {}: loss_seg {:.4f}  mIoU {:.3f}  with a pose {}/{}  median pose "
                  "error {}",
                  row.samples, v.Mean("loss_seg"), v.Mean("miou"), v.samples_with_pose, v.samples,
                  MedianPoseError(v)));
}

void ProgressSink::Line(const std::string& text) { line_.Say(text); }

TensorBoardSink::TensorBoardSink(const std::filesystem::path& folder,
                                 const std::string& config_yaml, std::int64_t samples)
    : file_(folder) {
  file_.Restart(samples + 1);
  // A Markdown block that keeps lines and spaces.
  file_.Text(samples, "config", Indented(config_yaml, "    "));
}

void TensorBoardSink::Train(const TrainRow& row) {
  file_.Scalars(row.samples, ScalarsOf(RowOf(row)));
}

void TensorBoardSink::Validation(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  file_.Scalars(row.samples, ScalarsOf(RowOf(row)));
  if (!v.examples.empty()) {
    file_.Picture(row.samples, "validation/depth, labels, predicted", LabelPictures(v.examples));
  }
}

RgbImage LabelPictures(const std::vector<LabelExample>& examples) {
  constexpr double kNear = 0.5, kFar = 4;  // m, the range of the colours of depth
  std::vector<RgbImage> pictures;
  for (const LabelExample& example : examples) {
    pictures.push_back(ColourDepth(example.depth, kNear, kFar));
    pictures.push_back(ColourLabels(example.labels));
    pictures.push_back(ColourLabels(example.predicted));
  }
  return Shelves(pictures, 3);
}

}  // namespace volalign
