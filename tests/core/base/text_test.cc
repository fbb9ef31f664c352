#include "core/base/text.h"

#include <gtest/gtest.h>

namespace volalign::text_test {
namespace {

using Parts = std::vector<std::string>;

TEST(Text, Splits) {
  EXPECT_EQ(Split("a,,b,", ','), (Parts{"a", "", "b", ""}));
  EXPECT_EQ(Split("", ','), Parts{""});
}

TEST(Text, IndentsLinesThatHoldSomething) {
  EXPECT_EQ(Indented("a:\n\n  b: 1", "  "), "  a:\n\n    b: 1\n");
  EXPECT_EQ(Indented("", "  "), "");
}

TEST(Text, Quotes) {
  EXPECT_EQ(CsvQuoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
  EXPECT_EQ(MarkdownCell("a|b|"), "a\\|b\\|");
  EXPECT_EQ(Lower("KA03_Depth"), "ka03_depth");
}

}  // namespace
}  // namespace volalign::text_test
