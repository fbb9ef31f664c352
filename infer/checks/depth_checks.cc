#include "infer/checks/depth_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "core/base/statistics.h"

namespace volalign {

namespace {

/// m: a depth of a structure in a room, for the guess at the unit that was meant.
constexpr double kNearRoom = 0.5, kFarRoom = 8;
constexpr double kFarQuantile = 0.95;

std::vector<float> MeasuredDepths(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  return values;
}

/// A sentence for depths that no room gives.
std::optional<std::string> UnitProblem(const std::vector<float>& depths,
                                       const VerdictOptions& options) {
  const double median = Quantile(depths, 0.5), far = Quantile(depths, kFarQuantile);
  const bool beyond = median > options.max_median_depth_m;
  if (!beyond && far >= options.min_far_depth_m) return std::nullopt;
  std::string text =
      fmt::format("half of its depths are {} {:.3g} m", beyond ? "beyond" : "under", median);
  const std::vector<double> factors =
      beyond ? std::vector<double>{0.1, 0.001} : std::vector<double>{10.0, 1000.0};
  for (const double factor : factors) {
    if (median * factor < kNearRoom || median * factor > kFarRoom) continue;
    return text + fmt::format("; its depth_scale seems to be {} times too {}",
                              factor < 1 ? std::lround(1 / factor) : std::lround(factor),
                              factor < 1 ? "large" : "small");
  }
  return text + ", where no structure can be";
}

}  // namespace

std::vector<DepthFinding> CheckDepths(const std::vector<SensorFrame>& frames,
                                      const std::vector<SensorView>& views,
                                      const VerdictOptions& options) {
  std::vector<DepthFinding> findings(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const DepthImage& depth = views[i].depth;
    const std::vector<float> measured = MeasuredDepths(depth);
    const double valid =
        depth.empty() ? 0
                      : static_cast<double>(measured.size()) / static_cast<double>(depth.size());
    if (valid < options.min_valid_share) {
      findings[i].failure = Finding{SensorCode::kNoDepth,
                                    fmt::format("{:.1f} % of the pixels have depth", 100 * valid),
                                    "check the depth file and the sensor's lens cap"};
      continue;
    }
    if (const std::optional<std::string> problem = UnitProblem(measured, options)) {
      findings[i].failure =
          Finding{SensorCode::kWrongUnits, *problem, "correct depth_scale in the capture"};
      continue;
    }
    for (std::size_t j = 0; j < i; ++j) {
      if (findings[j].failure || !(views[j].depth == depth)) continue;
      findings[i].same_depth_as = frames[j].name;
      findings[j].same_depth_as = frames[i].name;
      findings[i].failure =
          Finding{SensorCode::kDuplicateDepth,
                  fmt::format("its depth map is that of {}, pixel for pixel", frames[j].name),
                  "check the sensors' depth files: one of them is given twice"};
      break;
    }
  }
  return findings;
}

}  // namespace volalign
