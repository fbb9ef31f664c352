#include "infer/formats/read_budget.h"

#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/unpack.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::read_budget_test {
namespace {

TEST(ReadBudget, IsOfAllPartsTogether) {
  ReadBudget budget(100);
  budget.Unpack(60, "a");
  ExpectError<DataError>([&] { budget.Unpack(41, "b"); }, {"b: ", "unpacked"});
  EXPECT_TRUE(budget.Spend(40));
  EXPECT_FALSE(budget.Spend(1));
  // What is kept counts by itself, and may be let go.
  budget.Keep(60, "a");
  ExpectError<DataError>([&] { budget.Keep(41, "c"); }, {"c: ", "memory"});
  budget.Drop(60);
  budget.Keep(100, "a");
  EXPECT_EQ(budget.kept(), 100u);
}

TEST(ReadBudget, AFileAllowsMoreOnce) {
  const TempFolder folder;
  const auto file = folder.Write("a", std::string(100000, 'x'));
  ReadBudget budget(0);
  budget.Open(file);
  EXPECT_TRUE(budget.Spend(100000));
  while (budget.Spend(1 << 16)) {
  }
  budget.Open(file);
  EXPECT_FALSE(budget.Spend(1 << 16));
  budget.Open(folder / "none");
  EXPECT_FALSE(budget.Spend(1 << 16));
}

TEST(ReadBudget, CountsThePixelsOfImages) {
  const TempFolder folder;
  std::string pgm = "P5 1000 500 65535\n";
  pgm.resize(pgm.size() + 1000000);
  const auto file = folder.Write("a.pgm", pgm);
  ReadBudget budget(0);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(BytesOf(ReadStoredDepth(file, &budget)), 2000000u);
  ExpectError<DataError>(
      [&] {
        for (int i = 0; i < 100; ++i) ReadStoredDepth(file, &budget);
      },
      {"a.pgm", "unpacked"});
}

TEST(UnpackZstd, SaysWhatIsDamaged) {
  ReadBudget budget;
  ExpectError<DataError>(
      [&] { formats_internal::UnpackZstd("\x28\xb5\x2f\xfd", 100, "a", &budget); }, {"a: damaged"});
  ExpectError<DataError>([&] { formats_internal::UnpackZstd("none", 100, "a", &budget); },
                         {"a: damaged"});
}

}  // namespace
}  // namespace volalign::read_budget_test
