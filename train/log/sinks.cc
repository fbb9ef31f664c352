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

namespace volalign {
namespace {

using nlohmann::json;

std::string Duration(double seconds) {
  const auto s = static_cast<long>(std::max(0.0, seconds));
  if (s >= 3600) return fmt::format("{}h{:02}m", s / 3600, s / 60 % 60);
  return fmt::format("{}m{:02}s", s / 60, s % 60);
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

void JsonlSink::Train(const TrainRow& row) {
  const StepReport& mean = row.mean;
  const json j = {{"type", "train"},
                  {"step", row.step},
                  {"samples", row.samples},
                  {"loss", mean.loss},
                  {"loss_seg", mean.loss_seg},
                  {"loss_3d", mean.loss_3d},
                  {"degenerate", mean.degenerate},
                  {"gradient_norm", mean.gradient_norm},
                  {"lr", row.lr},
                  {"samples_per_s", row.samples_per_s},
                  {"step_s",
                   {{"data", mean.times.data},
                    {"forward", mean.times.forward},
                    {"loss", mean.times.loss},
                    {"backward", mean.times.backward},
                    {"optim", mean.times.optim}}}};
  Write(j.dump());
}

void JsonlSink::Validation(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  json j = {{"type", "validation"},
            {"step", row.step},
            {"samples", row.samples},
            {"validation_samples", v.samples},
            {"posed", v.posed}};
  for (const auto& [name, value] : NamedMeans(v)) j[name] = value;
  Write(j.dump());
}

ProgressSink::ProgressSink(std::int64_t total)
    : total_(total), terminal_(isatty(STDERR_FILENO) != 0) {}

void ProgressSink::Train(const TrainRow& row) {
  const double share = static_cast<double>(row.samples) / static_cast<double>(total_);
  const std::string text = fmt::format(
      "{}/{}  loss {:.4f}{}  {:.1f} samples/s  lr {:.2e}  {} left", row.samples, total_,
      row.mean.loss, miou_, row.samples_per_s, row.lr,
      Duration(static_cast<double>(total_ - row.samples) / std::max(row.samples_per_s, 1e-9)));
  if (terminal_) {
    constexpr int kWidth = 30;
    const int full = std::min(kWidth, static_cast<int>(share * kWidth));
    fmt::print(stderr, "\r[{:=<{}}{:<{}}] {}\033[K", "", full, "", kWidth - full, text);
  } else {
    fmt::print(stderr, "{:5.1f} %  {}\n", 100 * share, text);
  }
  std::fflush(stderr);
}

void ProgressSink::Validation(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  miou_ = fmt::format("  mIoU {:.3f}", v.miou);
  Line(
      fmt::format("validation at {}: loss_seg {:.4f}  mIoU {:.3f}  posed {}/{}  median pose "
                  "error {}",
                  row.samples, v.loss_seg, v.miou, v.posed, v.samples, MedianPoseError(v)));
}

void ProgressSink::Line(const std::string& text) {
  fmt::print(stderr, "{}{}\n", terminal_ ? "\r\033[K" : "", text);
}

}  // namespace volalign
