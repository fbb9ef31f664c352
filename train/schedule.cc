#include "train/schedule.h"

#include <algorithm>
#include <cmath>

namespace volalign {

double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total) {
  const std::int64_t since = samples - config.warmup_samples;
  if (since < 0) {
    return config.lr * static_cast<double>(samples + 1) /
           static_cast<double>(config.warmup_samples + 1);
  }
  if (config.schedule == Schedule::kConstant) return config.lr;
  const double rest = static_cast<double>(std::max<std::int64_t>(1, total - config.warmup_samples));
  return config.lr * 0.5 * (1 + std::cos(M_PI * std::min(1.0, static_cast<double>(since) / rest)));
}

}  // namespace volalign
