#pragma once

#include <filesystem>
#include <vector>

#include "core/base/image.h"
#include "infer/view/segmenter.h"

namespace volalign {

/// The attention of a checkpoint's network (StructureNet::ForwardWithAttention) for frames,
/// prepared as in LoadNetworkSegmenter. There is one map per frame, of its size and orientation,
/// from 0 to 1, as the decoder enlarges it, for pixels with and without depth. Maps are empty for a
/// network without attention. Runs on the CPU. Throws as LoadNetworkSegmenter.
std::vector<Image<float>> AttentionMaps(const std::filesystem::path& checkpoint,
                                        const std::vector<SegmentationRequest>& requests);

}  // namespace volalign
