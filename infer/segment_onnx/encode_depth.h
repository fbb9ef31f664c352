#pragma once

#include <vector>

#include "core/base/image.h"
#include "core/model/network_options.h"

namespace volalign {

/// A network's input for a depth map (EncodedChannels): C planes of H rows of W values one after
/// the other. Depth is in metres, 0 for none.
std::vector<float> EncodeDepth(const DepthImage& depth, InputEncoding input);

}  // namespace volalign
