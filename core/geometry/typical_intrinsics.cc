#include "core/geometry/typical_intrinsics.h"

#include <algorithm>
#include <cmath>

#include "core/geometry/shipped_intrinsics.h"

namespace volalign {

namespace {

const std::vector<IntrinsicsPoolEntry>& Pool() {
  static const std::vector<IntrinsicsPoolEntry> pool =
      ParseIntrinsicsPool(shipped::kIntrinsics, "configs/intrinsics.yaml");
  return pool;
}

Intrinsics Mean(const IntrinsicsPoolEntry& entry) {
  const Intrinsics& first = entry.intrinsics.front();
  Intrinsics mean{first.width, first.height, 0, 0, 0, 0, {}};
  for (const Intrinsics& device : entry.intrinsics) {
    const double share = 1.0 / static_cast<double>(entry.intrinsics.size());
    mean.fx += share * device.fx;
    mean.fy += share * device.fy;
    mean.cx += share * device.cx;
    mean.cy += share * device.cy;
  }
  return mean;
}

/// More than the difference of devices of a kind, as a share.
constexpr double kOther = 0.05;

bool IsNear(double a, double b) { return std::abs(std::log(a / b)) < kOther; }

}  // namespace

std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height) {
  for (const IntrinsicsPoolEntry& entry : Pool()) {
    const Intrinsics& first = entry.intrinsics.front();
    if (entry.sensor == sensor && first.width * height == first.height * width)
      return Mean(entry).Resized(width, height);
  }
  return std::nullopt;
}

std::optional<Intrinsics> OfAnotherSize(const std::string& sensor, const Intrinsics& given) {
  std::optional<Intrinsics> other;
  for (const IntrinsicsPoolEntry& entry : Pool()) {
    if (entry.sensor != sensor) continue;
    const Intrinsics mean = Mean(entry);
    const double scale = given.fx / mean.fx;
    const Intrinsics full = mean.Resized(std::max(1, static_cast<int>(scale * mean.width + 0.5)),
                                         std::max(1, static_cast<int>(scale * mean.height + 0.5)));
    if (IsNear(full.width, given.width) && IsNear(full.height, given.height)) return std::nullopt;
    if (IsNear(full.fy, given.fy) && std::abs(full.cx - given.cx) < kOther * given.fx &&
        std::abs(full.cy - given.cy) < kOther * given.fy)
      other = full;
  }
  return other;
}

}  // namespace volalign
