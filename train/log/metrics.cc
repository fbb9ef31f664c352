#include "train/log/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace volalign {

double ValidationResult::Mean(const std::string& name) const {
  const auto found = means.find(name);
  return found == means.end() ? 0 : found->second;
}

std::string MedianPoseError(const ValidationResult& result) {
  if (result.samples_with_pose == 0) return "-";
  return fmt::format("{:.1f} cm, {:.2f} deg", 100 * result.Mean("median_translation_error_m"),
                     result.Mean("median_rotation_error_deg"));
}

bool BestValidation::Note(const ValidationResult& result, std::int64_t at_samples) {
  const double miou = result.Mean("miou");
  if (!std::isfinite(miou) || (samples >= 0 && miou <= value)) return false;
  *this = {at_samples, miou};
  return true;
}

double Total(const StepTimes& t) { return t.data + t.forward + t.loss + t.backward + t.optim; }

StepTimes ShareOut(const StepTimes& all, const StepTimes& measured) {
  const double computing = Total(measured) - measured.data;
  const double scale = computing > 0 ? (Total(all) - all.data) / computing : 0;
  return {all.data, scale * measured.forward, scale * measured.loss, scale * measured.backward,
          scale * measured.optim};
}

void StepMeans::Add(const StepReport& more, std::int64_t more_samples) {
  samples += more_samples;
  sum.steps += more.steps;
  sum.skipped += more.skipped;
  sum.degenerate_samples += more.degenerate_samples;
  sum.loss += more.loss;
  for (const auto& [name, value] : more.terms) sum.terms[name] += value;
  sum.gradient_norm += more.gradient_norm;
  for (const auto& [name, part] : kStepParts) sum.times.*part += more.times.*part;
}

TrainRow StepMeans::Take(std::int64_t step, std::int64_t samples_so_far, double lr) {
  TrainRow row{step, samples_so_far, lr, 0, sum};
  StepTimes& t = row.mean.times;
  row.samples_per_s = static_cast<double>(samples) / Total(t);
  const auto finite = static_cast<double>(std::max<std::int64_t>(sum.steps - sum.skipped, 1));
  row.mean.loss /= finite;
  for (auto& [name, value] : row.mean.terms) value /= finite;
  row.mean.gradient_norm /= finite;
  for (const auto& [name, part] : kStepParts) t.*part /= static_cast<double>(sum.steps);
  *this = StepMeans();
  return row;
}

}  // namespace volalign
