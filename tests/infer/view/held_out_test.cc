#include "infer/view/held_out.h"

#include <gtest/gtest.h>

#include <map>

#include "core/base/random.h"

namespace volalign::held_out_test {
namespace {

TEST(UseOfBlock, IsTheSameAllOverABlock) {
  for (int v = 0; v < 64; ++v) {
    for (int u = 0; u < 64; ++u) {
      EXPECT_EQ(UseOfBlock(u, v),
                UseOfBlock(u / kHeldOutBlock * kHeldOutBlock, v / kHeldOutBlock * kHeldOutBlock));
    }
  }
}

TEST(UseOfBlock, FourFifthsFitTheRestAccepts) {
  std::map<BlockUse, int> count;
  constexpr int kBlocks = 100;
  for (int v = 0; v < kBlocks; ++v) {
    for (int u = 0; u < kBlocks; ++u) ++count[UseOfBlock(u * kHeldOutBlock, v * kHeldOutBlock)];
  }
  // Four standard deviations of a binomial count.
  EXPECT_NEAR(count[BlockUse::kFit], 8000, 160);
  EXPECT_NEAR(count[BlockUse::kAccept], 2000, 160);
}

}  // namespace
}  // namespace volalign::held_out_test
