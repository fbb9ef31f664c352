#include "infer/view/held_out.h"

#include <cstdint>

#include "core/random.h"

namespace volalign {

BlockUse UseOfBlock(int u, int v) {
  const auto block = static_cast<std::uint64_t>(v / kHeldOutBlock) << 32 |
                     static_cast<std::uint64_t>(u / kHeldOutBlock);
  RandomStream random(0, block, "held_out");
  if (random.Below(5) != 0) return BlockUse::kFit;
  return random.Below(4) == 0 ? BlockUse::kChoose : BlockUse::kAccept;
}

}  // namespace volalign
