#include "infer/view/held_out.h"

#include <cstdint>

#include "core/random.h"

namespace volalign {

bool HeldOut(int u, int v) {
  const auto block = static_cast<std::uint64_t>(v / kHeldOutBlock) << 32 |
                     static_cast<std::uint64_t>(u / kHeldOutBlock);
  return RandomStream(0, block, "held_out").Below(5) == 0;
}

}  // namespace volalign
