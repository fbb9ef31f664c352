#include "core/base/provenance.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <regex>

#include "core/base/error.h"

namespace volalign {
namespace {

class Provenance : public ::testing::Test {
 protected:
  void TearDown() override { ::unsetenv("SOURCE_DATE_EPOCH"); }
};

TEST_F(Provenance, ToolIsVersionAndCommit) {
  const std::regex form(
      "volalign [0-9]+\\.[0-9]+\\.[0-9]+( \\([0-9a-f]{7,}(-dirty)? of "
      "[0-9]{4}-[0-9]{2}-[0-9]{2}\\))?");
  EXPECT_TRUE(std::regex_match(Tool(), form)) << Tool();
  EXPECT_EQ(Tool().rfind("volalign " + Version(), 0), 0u);
}

TEST_F(Provenance, TimeIsUtc) {
  EXPECT_TRUE(std::regex_match(
      UtcNow(), std::regex("20[0-9]{2}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z")));
}

TEST_F(Provenance, TimeIsThatOfSourceDateEpoch) {
  ::setenv("SOURCE_DATE_EPOCH", "951782399", 1);
  EXPECT_EQ(UtcNow(), "2000-02-28T23:59:59Z");
}

TEST_F(Provenance, SourceDateEpochHasToBeANumber) {
  for (const char* wrong : {"", "yesterday", "12x", "-1", "99999999999999999999"}) {
    ::setenv("SOURCE_DATE_EPOCH", wrong, 1);
    EXPECT_THROW(UtcNow(), ConfigError) << wrong;
  }
}

}  // namespace
}  // namespace volalign
