#include "infer/view/held_out.h"

#include <cstdint>

#include "core/base/random.h"

namespace volalign {

namespace {

constexpr int kHeldOutOneIn = 5;  // blocks, of which one is held out

}  // namespace

BlockUse UseOfBlock(int u, int v) {
  const auto block = static_cast<std::uint64_t>(v / kHeldOutBlock) << 32 |
                     static_cast<std::uint64_t>(u / kHeldOutBlock);
  RandomStream random(0, block, "held_out");
  return random.Below(kHeldOutOneIn) == 0 ? BlockUse::kAccept : BlockUse::kFit;
}

}  // namespace volalign
