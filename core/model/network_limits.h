#pragma once

namespace volalign {

// What a network's options may be, so that neither a recipe nor a file's metadata asks for any
// amount of memory. The paper's network has 32 channels and 4 blocks.
inline constexpr int kMostBaseChannels = 1024;
inline constexpr int kMostResidualBlocks = 64;
inline constexpr int kMostClasses = 256;  ///< labels are uint8

}  // namespace volalign
