#include "infer/view/held_out.h"

#include <cstdint>

#include "core/random.h"

namespace volalign {

namespace {

constexpr int kAcceptOneIn = 5;  // blocks, of which one accepts poses
constexpr int kChooseOneIn = 8;  // of the others, of which one chooses estimates

}  // namespace

BlockUse UseOfBlock(int u, int v) {
  const auto block = static_cast<std::uint64_t>(v / kHeldOutBlock) << 32 |
                     static_cast<std::uint64_t>(u / kHeldOutBlock);
  RandomStream random(0, block, "held_out");
  if (random.Below(kAcceptOneIn) == 0) return BlockUse::kAccept;
  return random.Below(kChooseOneIn) == 0 ? BlockUse::kChoose : BlockUse::kFit;
}

}  // namespace volalign
