#pragma once

#include <optional>

#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/lens/sensor_lens.h"
#include "infer/lens/straightness.h"

namespace volalign {

/// Do large planes look bent through the lenses as they are, more than their priors allow? Then
/// poses that rest on them are off by more than their standard deviations say. `planes`: at the
/// lenses' changes. `estimated`: that is what the lenses' changes
/// were allowed to be. A lens whose focal length is far from the one given is suspect too.
PerFrame<std::optional<Finding>> CheckLenses(const PerFrame<SensorPlanes>& planes,
                                             const LensSet& lenses, bool estimated);

}  // namespace volalign
