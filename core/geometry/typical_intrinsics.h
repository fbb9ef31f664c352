#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"

namespace volalign {

/// Reads text like that of `configs/intrinsics.yaml`; `path` begins messages. Throws ConfigError
/// (unknown keys too).
std::vector<IntrinsicsPoolEntry> ParseIntrinsicsPool(const std::string& yaml,
                                                     const std::string& path);

/// The mean of the intrinsics of the devices of this kind (SensorFrame::sensor), scaled to this
/// resolution, px, without distortion, by the pool that the program carries within itself. Nothing
/// for a name that is not in it, and where the pool has no resolution of this aspect ratio.
std::optional<Intrinsics> TypicalIntrinsics(const std::string& sensor, int width, int height);

/// Those of the kind's frames of another size that `given` seems to be: by its focal length and its
/// principal point, scaled to them. Nothing where the kind has frames of the size of `given`.
std::optional<Intrinsics> OfAnotherSize(const std::string& sensor, const Intrinsics& given);

}  // namespace volalign
