#include "infer/evaluate/variants.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::variants_test {
namespace {

TEST(Variants, OneAValueOverTheSharedOptions) {
  ConfigSource source;
  source.Set("refine.edge_weight=7");
  const auto variants = ReadVariants(source, "initial.method=paper,network");
  ASSERT_EQ(variants.size(), 2u);
  EXPECT_EQ(variants[0].name, "paper");
  EXPECT_EQ(variants[0].options.initial.method, PoseMethod::kPaper);
  EXPECT_EQ(variants[1].name, "network");
  EXPECT_EQ(variants[1].options.initial.method, PoseMethod::kNetwork);
  for (const EvaluationVariant& variant : variants)
    EXPECT_EQ(variant.options.refine.edge_weight, 7);
  const auto alone = ReadVariants(source, "");
  ASSERT_EQ(alone.size(), 1u);
  EXPECT_EQ(alone[0].name, "volalign");
  EXPECT_EQ(alone[0].options.refine.edge_weight, 7);
}

TEST(Variants, BadOnesAreErrors) {
  for (const char* bad : {"initial.method", "=1", "initial.method=", "refine.edge_weight=1,1",
                          "refine.edge_wait=1"}) {
    ExpectError<ConfigError>([&] { ReadVariants(ConfigSource(), bad); });
  }
}

}  // namespace
}  // namespace volalign::variants_test
