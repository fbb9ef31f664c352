#include "infer/checks/depth_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/statistics.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// m: a depth of a structure in a room, for the guess at the unit that was meant.
constexpr double kNearRoom = 0.5, kFarRoom = kFarthest;
constexpr double kFarQuantile = 1 - kNotable;

std::vector<float> MeasuredDepths(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  return values;
}

/// In metres, as a person writes them.
std::string Metres(double depth) {
  return fmt::format(depth < 10 ? "{:.3g} m" : "{:.0f} m", depth);
}

/// Of depths that no room gives.
std::optional<DepthFinding> UnitProblem(const std::vector<float>& depths, double depth_scale,
                                        const VerdictOptions& options) {
  const double median = Quantile(depths, 0.5), far = Quantile(depths, kFarQuantile);
  const bool beyond = median > options.max_median_depth_m;
  if (!beyond && far >= options.min_far_depth_m) return std::nullopt;
  const std::string text =
      fmt::format("half of its depths are {} {}", beyond ? "beyond" : "under", Metres(median));
  DepthFinding problem;
  for (const int times : {10, 1000}) {
    const double factor = beyond ? 1. / times : times;
    if (median * factor < kNearRoom || median * factor > kFarRoom) continue;
    problem.unit_factor = factor;
    problem.failure = Finding{
        SensorCode::kWrongUnits,
        text + fmt::format("; its depth_scale seems to be {} times too {}", times,
                           beyond ? "large" : "small"),
        fmt::format("set depth_scale to {:g}, it is {:g}", depth_scale * factor, depth_scale)};
    return problem;
  }
  problem.failure = Finding{SensorCode::kWrongUnits, text + ", where no structure can be",
                            "correct depth_scale in the capture"};
  return problem;
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
    if (std::optional<DepthFinding> problem =
            UnitProblem(measured, frames[i].depth_scale, options)) {
      findings[i] = *std::move(problem);
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

void RequireUnits(const std::vector<SensorFrame>& frames,
                  const std::vector<DepthFinding>& findings) {
  std::set<std::pair<double, double>> wrong;  // factor and depth_scale
  std::size_t example = 0, agreeing = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const DepthFinding& finding = findings[i];
    if (finding.failure && finding.failure->code == SensorCode::kNoDepth) continue;
    if (!finding.unit_factor) return;
    if (wrong.empty()) example = i;
    ++agreeing;
    wrong.emplace(*finding.unit_factor, frames[i].depth_scale);
  }
  if (wrong.size() != 1 || agreeing < 2) return;
  const Finding& finding = *findings[example].failure;
  throw DataError(
      fmt::format("no sensor's depths are in the unit that is stated (sensor \"{}\": {}); {}",
                  frames[example].name, finding.reason, finding.hint));
}

}  // namespace volalign
