#pragma once

#include <optional>
#include <vector>

#include "infer/checks/outcome.h"
#include "infer/checks/verdict.h"
#include "infer/refine/straightness.h"
#include "infer/view/sensor_lens.h"

namespace volalign {

/// Do large planes look bent through the lenses as they are, more than their priors allow? Then
/// poses that rest on them are off by more than their standard deviations say. One result a frame;
/// `planes` are the frames', at the lenses' changes. `estimated`: that is what the lenses' changes
/// were allowed to be. A lens whose focal length is far from the one given is suspect too.
std::vector<std::optional<Finding>> CheckLenses(const std::vector<SensorPlanes>& planes,
                                                const LensSet& lenses, bool estimated,
                                                const LensCheckOptions& options);

}  // namespace volalign
