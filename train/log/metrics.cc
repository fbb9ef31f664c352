#include "train/log/metrics.h"

#include <fmt/format.h>

#include <cmath>

#include "core/config/config_word.h"

namespace volalign {

namespace {

/// Those of which a row has the mean.
std::array<double*, 9> Numbers(StepReport* report) {
  StepTimes& t = report->times;
  return {&report->loss, &report->loss_seg, &report->loss_3d, &report->gradient_norm,
          &t.data,       &t.forward,        &t.loss,          &t.backward,
          &t.optim};
}

}  // namespace

std::string MedianPoseError(const ValidationResult& result) {
  if (result.posed == 0) return "-";
  return fmt::format("{:.1f} cm, {:.2f} deg", 100 * result.median_translation_error_m,
                     result.median_rotation_error_deg);
}

std::vector<std::pair<std::string, double>> NamedMeans(const ValidationResult& result) {
  std::vector<std::pair<std::string, double>> means = {{"loss_seg", result.loss_seg},
                                                       {"loss_3d", result.loss_3d},
                                                       {"miou", result.miou},
                                                       {"miou_authors", result.miou_authors}};
  if (result.posed == 0) return means;
  means.insert(means.end(), {{"keypoint_rmse_m", result.keypoint_rmse_m},
                             {"median_translation_error_m", result.median_translation_error_m},
                             {"median_rotation_error_deg", result.median_rotation_error_deg}});
  return means;
}

bool BestValidation::Note(BestMetric metric, const ValidationResult& result,
                          std::int64_t at_samples) {
  const char* const name = WordOf(kBestMetrics, metric);
  for (const auto& [mean, found] : NamedMeans(result)) {
    if (mean != name || !std::isfinite(found)) continue;
    const bool better = LargerIsBetter(metric) ? found > value : found < value;
    if (samples >= 0 && !better) continue;
    *this = {at_samples, found, 0};
    return true;
  }
  ++since;
  return false;
}

bool LargerIsBetter(BestMetric metric) {
  return metric == BestMetric::kMiou || metric == BestMetric::kMiouAuthors;
}

void StepMeans::Add(const StepReport& step, std::int64_t step_samples) {
  ++steps;
  samples += step_samples;
  sum.degenerate += step.degenerate;
  StepReport added = step;
  const auto sums = Numbers(&sum), numbers = Numbers(&added);
  for (std::size_t i = 0; i < sums.size(); ++i) *sums[i] += *numbers[i];
}

TrainRow StepMeans::Take(std::int64_t step, std::int64_t samples_so_far, double lr) {
  TrainRow row{step, samples_so_far, lr, 0, sum};
  const double n = static_cast<double>(steps);
  StepTimes& t = row.mean.times;
  row.samples_per_s =
      static_cast<double>(samples) / (t.data + t.forward + t.loss + t.backward + t.optim);
  for (double* value : Numbers(&row.mean)) *value /= n;
  *this = StepMeans();
  return row;
}

}  // namespace volalign
