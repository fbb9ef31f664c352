#pragma once

namespace volalign {

/// Side of the square image blocks that are held out or used as a whole, px.
inline constexpr int kHeldOutBlock = 16;

/// Does this pixel lie in one of the held-out blocks, a fifth of all? No fit may use them, so that
/// they can tell whether a refined pose is better than the initial one.
bool HeldOut(int u, int v);

}  // namespace volalign
