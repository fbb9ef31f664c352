#pragma once

namespace volalign {

// Limits of a network's options. So neither a recipe nor a file's metadata can ask for any amount
// of memory. The paper's network has 32 channels and 4 blocks.
inline constexpr int kMostBaseChannels = 1024;
inline constexpr int kMostResidualBlocks = 64;
inline constexpr int kMostClasses = 256;  ///< labels are uint8

}  // namespace volalign
