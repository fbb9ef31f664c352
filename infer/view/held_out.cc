#include "infer/view/held_out.h"

#include <cstdint>

#include "core/random.h"

namespace volalign {

namespace {

constexpr int kOneIn = 5;  // blocks, of which one is held out

}  // namespace

bool HeldOut(int u, int v) {
  const auto block = static_cast<std::uint64_t>(v / kHeldOutBlock) << 32 |
                     static_cast<std::uint64_t>(u / kHeldOutBlock);
  return RandomStream(0, block, "held_out").Below(kOneIn) == 0;
}

}  // namespace volalign
