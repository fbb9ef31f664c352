#include "infer/checks/depth_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "core/base/statistics.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr double kLeastValid = 0.01;  // share of pixels with depth
constexpr double kMostMedian = 10;    // m, of a frame in a room
/// m: one pixel in twenty has to be farther, since no sensor sees a structure from nearer.
constexpr double kLeastFar = 0.9;

/// m: bounds of a structure's depth in a room.
constexpr double kNearRoom = 0.5, kFarRoom = kFarthest;
constexpr double kFarQuantile = 1 - kNotable;

std::string Metres(double depth) {
  return fmt::format(depth < 10 ? "{:.3g} m" : "{:.0f} m", depth);
}

std::string Times(double factor) { return fmt::format(factor < 10 ? "{:.1f}" : "{:.0f}", factor); }

/// A finding about depths that no room gives; else nothing.
std::optional<DepthFinding> UnitProblem(const std::vector<float>& depths, double depth_scale) {
  const double median = Quantile(depths, 0.5), far = Quantile(depths, kFarQuantile);
  const bool beyond = median > kMostMedian;
  if (!beyond && far >= kLeastFar) return std::nullopt;
  const std::string text =
      fmt::format("half of its depths are {} {}", beyond ? "beyond" : "under", Metres(median));
  const double least = beyond ? median / kFarRoom : kNearRoom / median,
               most = beyond ? median / kNearRoom : kFarRoom / median;
  DepthFinding problem;
  problem.failure = Finding{
      SensorCode::kWrongUnits,
      text + fmt::format(", where no structure can be; its depth_scale is {} to {} times too {}",
                         Times(least), Times(most), beyond ? "large" : "small"),
      fmt::format("set depth_scale to what its software states, between {:.2g} and {:.2g}; it is "
                  "{:g}. Usual are 0.001 (millimetres), 0.0002 (TUM data sets), 0.00025 and 0.0001 "
                  "(RealSense L515 and D405)",
                  depth_scale * (beyond ? 1 / most : least),
                  depth_scale * (beyond ? 1 / least : most), depth_scale)};
  return problem;
}

}  // namespace

std::vector<float> MeasuredDepths(const DepthImage& depth) {
  std::vector<float> values;
  std::copy_if(depth.begin(), depth.end(), std::back_inserter(values),
               [](float z) { return z > 0; });
  return values;
}

std::vector<DepthFinding> CheckDepths(const std::vector<SensorFrame>& frames,
                                      const std::vector<SensorView>& views) {
  std::vector<DepthFinding> findings(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const DepthImage& depth = views[i].depth;
    const std::vector<float> measured = MeasuredDepths(depth);
    const double valid =
        depth.empty() ? 0
                      : static_cast<double>(measured.size()) / static_cast<double>(depth.size());
    if (valid < kLeastValid) {
      findings[i].failure = Finding{SensorCode::kNoDepth,
                                    fmt::format("{:.1f} % of the pixels have depth", 100 * valid),
                                    "check the depth file and the sensor's lens cap"};
      continue;
    }
    if (std::optional<DepthFinding> problem = UnitProblem(measured, frames[i].depth_scale)) {
      findings[i] = *std::move(problem);
      continue;
    }
    for (std::size_t j = 0; j < i; ++j) {
      if (findings[j].failure || !(views[j].depth == depth)) continue;
      findings[i].same_depth_as = frames[j].name;
      findings[j].same_depth_as = frames[i].name;
      findings[i].failure = Finding{
          SensorCode::kDuplicateDepth,
          fmt::format("its depth map is the same as that of {}, pixel for pixel", frames[j].name),
          "check the sensors' depth files: one of them is given twice"};
      break;
    }
  }
  return findings;
}

void DropStandIns(DepthImage* depth) {
  std::map<float, std::size_t> counts;
  for (const float z : *depth) {
    if ((z > 0 && z < kNearRoom) || z > kFarRoom) ++counts[z];
  }
  const double least = std::max<double>(kFewProbes, kNotable * static_cast<double>(depth->size()));
  for (const auto& [value, count] : counts) {
    if (static_cast<double>(count) < least) continue;
    const auto jump = static_cast<float>(DepthJump(value));
    std::size_t near = 0;
    for (auto other = counts.lower_bound(value - jump);
         other != counts.end() && other->first <= value + jump; ++other)
      near += other->second;
    if (static_cast<double>(near - count) > kNotable * static_cast<double>(count)) continue;
    std::replace(depth->begin(), depth->end(), value, 0.0f);
  }
}

}  // namespace volalign
