#include "infer/refine/options.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::options_test {
namespace {

TEST(ParseEstimate, NamesItsWords) {
  EXPECT_TRUE(ParseEstimate("auto").boxes);
  EXPECT_TRUE(ParseEstimate("auto").depth_offset);
  EXPECT_FALSE(ParseEstimate("none").size);
  const EstimateSet two = ParseEstimate("size, depth_gain");
  EXPECT_TRUE(two.size && two.depth_gain);
  EXPECT_FALSE(two.boxes || two.depth_offset);
  for (const char* bad : {"", "boxes,,size", "box", "auto,size", "size,"})
    ExpectError<ConfigError>([&] { ParseEstimate(bad); }, {"refine.estimate", "depth_offset"});
}

}  // namespace
}  // namespace volalign::options_test
