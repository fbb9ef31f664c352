#include "train/log/tensorboard_sink.h"

#include <vector>

#include "core/base/text.h"
#include "core/plot/picture.h"

namespace volalign {
namespace {

/// Range of colours for depth, m.
constexpr double kNear = 0.5, kFar = 4;

}  // namespace

TensorBoardSink::TensorBoardSink(const std::filesystem::path& folder,
                                 const std::string& config_yaml, std::int64_t samples)
    : file_(folder) {
  file_.Restart(samples + 1);
  // A Markdown block that keeps lines and spaces.
  file_.Text(samples, "config", Indented(config_yaml, "    "));
}

void TensorBoardSink::Train(const TrainRow& row) {
  const StepReport& mean = row.mean;
  const StepTimes& t = mean.times;
  std::vector<std::pair<std::string, double>> scalars = {
      {"train/loss", mean.loss},
      {"train/degenerate", static_cast<double>(mean.degenerate)},
      {"train/gradient_norm", mean.gradient_norm},
      {"train/lr", row.lr},
      {"speed/samples_per_s", row.samples_per_s},
      {"speed/data_s", t.data},
      {"speed/forward_s", t.forward},
      {"speed/loss_s", t.loss},
      {"speed/backward_s", t.backward},
      {"speed/optim_s", t.optim}};
  for (const auto& [name, value] : mean.terms) scalars.emplace_back("train/" + name, value);
  file_.Scalars(row.samples, scalars);
}

void TensorBoardSink::Validation(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  std::vector<std::pair<std::string, double>> scalars = {{"validation/posed", v.posed}};
  for (const auto& [name, value] : NamedMeans(v)) scalars.emplace_back("validation/" + name, value);
  file_.Scalars(row.samples, scalars);
  if (!v.examples.empty()) {
    file_.Picture(row.samples, "validation/depth, labels, predicted", LabelPictures(v.examples));
  }
}

RgbImage LabelPictures(const std::vector<LabelExample>& examples) {
  std::vector<RgbImage> pictures;
  for (const LabelExample& example : examples) {
    pictures.push_back(ColourDepth(example.depth, kNear, kFar));
    pictures.push_back(ColourLabels(example.labels));
    pictures.push_back(ColourLabels(example.predicted));
  }
  return Montage(pictures, 3);
}

}  // namespace volalign
