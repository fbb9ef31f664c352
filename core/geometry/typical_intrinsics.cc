#include "core/geometry/typical_intrinsics.h"

#include "core/geometry/shipped_intrinsics.h"

namespace volalign {

std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height) {
  static const std::vector<IntrinsicsPoolEntry> pool =
      ParseIntrinsicsPool(shipped::kIntrinsics, "configs/intrinsics.yaml");
  for (const IntrinsicsPoolEntry& entry : pool) {
    const Intrinsics& first = entry.intrinsics.front();
    if (entry.sensor != sensor || first.width * height != first.height * width) continue;
    Intrinsics mean{first.width, first.height, 0, 0, 0, 0, {}};
    for (const Intrinsics& device : entry.intrinsics) {
      const double share = 1.0 / static_cast<double>(entry.intrinsics.size());
      mean.fx += share * device.fx;
      mean.fy += share * device.fy;
      mean.cx += share * device.cx;
      mean.cy += share * device.cy;
    }
    return mean.Resized(width, height);
  }
  return std::nullopt;
}

}  // namespace volalign
