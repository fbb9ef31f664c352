#pragma once

namespace volalign {

/// Side of the square image blocks that are held out or used as a whole, px.
inline constexpr int kHeldOutBlock = 16;

/// Is this pixel in one of the fifth of all blocks that no fit may use, so that they can tell
/// whether a refined pose is better than the initial one?
bool HeldOut(int u, int v);

}  // namespace volalign
