#include "core/geometry/typical_intrinsics.h"

#include "core/geometry/shipped_intrinsics.h"

namespace volalign {

std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height) {
  static const std::vector<IntrinsicsPoolEntry> pool =
      ParseIntrinsicsPool(shipped::kIntrinsics, "configs/intrinsics.yaml");
  for (const IntrinsicsPoolEntry& entry : pool) {
    const Intrinsics& typical = entry.intrinsics.front();
    if (entry.sensor == sensor && typical.width * height == typical.height * width)
      return typical.Resized(width, height);
  }
  return std::nullopt;
}

}  // namespace volalign
