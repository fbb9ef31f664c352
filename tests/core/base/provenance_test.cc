#include "core/base/provenance.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <ctime>
#include <string>

#include "core/base/error.h"

namespace volalign {
namespace {

class Provenance : public ::testing::Test {
 protected:
  void TearDown() override { ::unsetenv("SOURCE_DATE_EPOCH"); }
};

TEST_F(Provenance, TimeIsNow) {
  std::string now, same;
  do {  // within one second
    const std::time_t clock = std::time(nullptr);
    ::unsetenv("SOURCE_DATE_EPOCH");
    now = UtcNow();
    ::setenv("SOURCE_DATE_EPOCH", std::to_string(clock).c_str(), 1);
    same = UtcNow();
    if (std::time(nullptr) == clock) break;
  } while (true);
  EXPECT_EQ(now, same);
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
