#pragma once

namespace volalign {

/// Side of the square image blocks that are held out or used as a whole, px.
inline constexpr int kHeldOutBlock = 16;

/// What the pixels of an image block are for. The two uses share no block, so that what is
/// judged by them was not made to fit them.
enum class BlockUse {
  /// Four fifths: poses and parameters are fitted to them.
  kFit,
  /// A fifth: whether a refined pose is better than the one it has to beat, sensor by
  /// sensor.
  kAccept
};
BlockUse UseOfBlock(int u, int v);

/// Is this pixel in one of the blocks that no fit may use?
inline bool HeldOut(int u, int v) { return UseOfBlock(u, v) != BlockUse::kFit; }

}  // namespace volalign
