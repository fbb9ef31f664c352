#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"

namespace volalign {

/// Reads text like that of `configs/intrinsics.yaml`; `path` begins messages. Throws ConfigError
/// (also for unknown keys).
std::vector<IntrinsicsPoolEntry> ParseIntrinsicsPool(const std::string& yaml,
                                                     const std::string& path);

/// The mean intrinsics of the devices of this kind (SensorFrame::sensor) in the pool that the
/// program contains. They are scaled to this resolution, px, without distortion. Nothing for an
/// unknown name, or if the pool has no resolution of this aspect ratio.
std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height);

/// Intrinsics of the kind's frames of another size, if `given` seems to be for these, by its focal
/// length and its principal point. Nothing if the kind has frames of the size of `given`.
std::optional<Intrinsics> OfAnotherSize(const std::string& sensor, const Intrinsics& given);

}  // namespace volalign
