#include "infer/formats/lens_names.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::formats_internal::lens_names_test {
namespace {

using Numbers = std::vector<double>;

TEST(NamedLens, TakesOpencvsModelsUnderTheirNames) {
  const Numbers lens = {0.1, -0.2, 0.001, 0.002, 0.05};
  for (const char* model :
       {"plumb_bob", "rational_polynomial", "Brown Conrady", "", "brown-conrady",
        "RS2_DISTORTION_BROWN_CONRADY", "distortion.brown_conrady"})
    EXPECT_EQ(NamedLens(model, lens, "file"), lens) << model;
  for (const char* model : {"equidistant", "Inverse Brown Conrady", "Kannala Brandt4"})
    ExpectError<DataError>([&] { NamedLens(model, lens, "file"); }, {"file", model});
}

TEST(NamedLens, ALensWithoutEffectHasAnyName) {
  EXPECT_EQ(NamedLens("equidistant", {0, 0, 0, 0}, "file"), Numbers(5));
  EXPECT_EQ(NamedLens("equidistant", {}, "file"), Numbers());
}

TEST(NamedLens, HasAtMostEightCoefficients) {
  Numbers lens = {1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 0};
  EXPECT_EQ(NamedLens("rational_polynomial", lens, "file"), (Numbers{1, 2, 3, 4, 5, 6, 7, 8}));
  lens[11] = 0.1;
  ExpectError<DataError>([&] { NamedLens("rational_polynomial", lens, "file"); },
                         {"file", "12 distortion coefficients"});
}

}  // namespace
}  // namespace volalign::formats_internal::lens_names_test
