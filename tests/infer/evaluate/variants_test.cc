#include "infer/evaluate/variants.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::variants_test {
namespace {

TEST(Variants, OneAValueOverTheSharedOptions) {
  ConfigSource source;
  source.Set("refine.box_sigma_m=0.007");
  const auto variants = ReadVariants(source, "initial.method=paper,network");
  ASSERT_EQ(variants.size(), 2u);
  EXPECT_EQ(variants[0].name, "paper");
  EXPECT_EQ(variants[0].options.initial.method, PoseMethod::kPaper);
  EXPECT_EQ(variants[1].name, "network");
  EXPECT_EQ(variants[1].options.initial.method, PoseMethod::kNetwork);
  for (const EvaluationVariant& variant : variants)
    EXPECT_EQ(variant.options.refine.box_sigma_m, 0.007);
  const auto alone = ReadVariants(source, "");
  ASSERT_EQ(alone.size(), 1u);
  EXPECT_EQ(alone[0].name, "volalign");
  EXPECT_EQ(alone[0].options.refine.box_sigma_m, 0.007);
}

TEST(Variants, BadOnesAreErrors) {
  for (const char* bad : {"initial.method", "=1", "initial.method=", "refine.box_sigma_m=0.1,0.1",
                          "refine.box_sigmas_m=0.1"}) {
    ExpectError<ConfigError>([&] { ReadVariants(ConfigSource(), bad); });
  }
}

}  // namespace
}  // namespace volalign::variants_test
