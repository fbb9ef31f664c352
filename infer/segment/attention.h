#pragma once

#include <filesystem>
#include <vector>

#include "core/base/image.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// The attention of a checkpoint's network (StructureNet::ForwardWithAttention) for frames, which
/// go through it as LoadNetworkSegmenter has them: one map each, of the frame's size and
/// orientation, from 0 to 1, as the decoder enlarges it, whether a pixel has depth or not. Empty
/// maps of a network without attention. Runs on the CPU. Throws as LoadNetworkSegmenter.
std::vector<Image<float>> AttentionMaps(const std::filesystem::path& checkpoint,
                                        const std::vector<SegmentationRequest>& requests);

}  // namespace volalign
