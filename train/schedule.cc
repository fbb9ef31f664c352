#include "train/schedule.h"

#include <algorithm>
#include <cmath>

namespace volalign {
namespace {

constexpr double kPi = 3.14159265358979323846;

}  // namespace

double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total) {
  if (samples < config.warmup_samples) {
    return config.lr * static_cast<double>(samples + 1) /
           static_cast<double>(config.warmup_samples + 1);
  }
  if (config.schedule == "constant") return config.lr;
  const double t = static_cast<double>(samples - config.warmup_samples) /
                   static_cast<double>(std::max<std::int64_t>(1, total - config.warmup_samples));
  return config.lr * 0.5 * (1 + std::cos(kPi * std::min(1.0, t)));
}

}  // namespace volalign
