#include "infer/view/held_out.h"

#include <cstdint>

#include "core/random.h"

namespace volalign {

namespace {

// Of blocks, the share that is held out: 3 of 20, as a quarter less than one in five.
constexpr int kCandidateOneIn = 5, kFitOneIn = 4;

}  // namespace

BlockUse UseOfBlock(int u, int v) {
  const auto block = static_cast<std::uint64_t>(v / kHeldOutBlock) << 32 |
                     static_cast<std::uint64_t>(u / kHeldOutBlock);
  RandomStream random(0, block, "held_out");
  const bool held_out = random.Below(kCandidateOneIn) == 0 && random.Below(kFitOneIn) != 0;
  return held_out ? BlockUse::kAccept : BlockUse::kFit;
}

}  // namespace volalign
