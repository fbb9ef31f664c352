#pragma once

#include <optional>

#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/lens/sensor_lens.h"
#include "infer/lens/straightness.h"

namespace volalign {

/// Do large planes look bent through the lenses by more than their priors allow? Poses that rest on
/// such planes are off by more than their standard deviations say. `planes`: through the lenses as
/// changed. `estimated`: lenses were estimated, which decides the hint. A lens whose focal length
/// is far from the one given is suspect too.
PerFrame<std::optional<Finding>> CheckLenses(const PerFrame<SensorPlanes>& planes,
                                             const LensSet& lenses, bool estimated);

}  // namespace volalign
