#include "train/tensorboard_sink.h"

#include <sstream>
#include <vector>

#include "core/picture.h"

namespace volalign {
namespace {

/// Depth is coloured between these, m.
constexpr double kNear = 0.5, kFar = 4;

/// A Markdown block that keeps lines and spaces.
std::string CodeBlock(const std::string& text) {
  std::string block;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) block += "    " + line + "\n";
  return block;
}

}  // namespace

TensorBoardSink::TensorBoardSink(const std::filesystem::path& folder,
                                 const std::string& config_yaml, std::int64_t samples)
    : file_(folder) {
  file_.Restart(samples + 1);
  file_.Text(samples, "config", CodeBlock(config_yaml));
}

void TensorBoardSink::Train(const TrainRow& row) {
  const StepReport& mean = row.mean;
  const StepTimes& t = mean.times;
  file_.Scalars(row.samples, {{"train/loss", mean.loss},
                              {"train/loss_seg", mean.loss_seg},
                              {"train/loss_3d", mean.loss_3d},
                              {"train/degenerate", static_cast<double>(mean.degenerate)},
                              {"train/gradient_norm", mean.gradient_norm},
                              {"train/lr", row.lr},
                              {"speed/samples_per_s", row.samples_per_s},
                              {"speed/data_s", t.data},
                              {"speed/forward_s", t.forward},
                              {"speed/loss_s", t.loss},
                              {"speed/backward_s", t.backward},
                              {"speed/optim_s", t.optim}});
}

void TensorBoardSink::Validation(const ValidationRow& row) {
  const ValidationResult& v = row.result;
  file_.Scalars(row.samples, {{"validation/loss_seg", v.loss_seg},
                              {"validation/loss_3d", v.loss_3d},
                              {"validation/miou", v.miou},
                              {"validation/miou_authors", v.miou_authors},
                              {"validation/posed", v.posed}});
  if (v.posed > 0) {
    file_.Scalars(row.samples,
                  {{"validation/keypoint_rmse_m", v.keypoint_rmse_m},
                   {"validation/median_translation_error_m", v.median_translation_error_m},
                   {"validation/median_rotation_error_deg", v.median_rotation_error_deg}});
  }
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
