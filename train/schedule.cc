#include "train/schedule.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"

namespace volalign {
namespace {

/// From lr to min_lr as t goes from 0 to 1.
double Cosine(const OptimConfig& config, double t) {
  return config.min_lr + (config.lr - config.min_lr) * 0.5 * (1 + std::cos(M_PI * t));
}

}  // namespace

double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total) {
  const std::int64_t since = samples - config.warmup_samples;
  if (since < 0) {
    return config.lr * static_cast<double>(samples + 1) /
           static_cast<double>(config.warmup_samples + 1);
  }
  const double rest = static_cast<double>(std::max<std::int64_t>(1, total - config.warmup_samples));
  const std::int64_t period = config.period_samples;
  switch (config.schedule) {
    case Schedule::kConstant:
      return config.lr;
    case Schedule::kStep: {
      const std::int64_t steps = since / period;
      return config.lr * std::pow(config.step_factor, static_cast<double>(steps));
    }
    case Schedule::kCosine:
      if (period > 0) {
        return Cosine(config, static_cast<double>(since % period) / static_cast<double>(period));
      }
      [[fallthrough]];
    case Schedule::kOneCycle:
      return Cosine(config, std::min(1.0, static_cast<double>(since) / rest));
  }
  throw Error("invalid Schedule");
}

}  // namespace volalign
