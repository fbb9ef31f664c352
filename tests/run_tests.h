#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

namespace volalign {

/// main() of a program of tests: runs those of the file that the first argument names, by the end
/// of its path, or all without one. Of these, `PART` as a further argument takes those alone whose
/// name has this part, and `-PART` leaves these out.
/// @return 2 where the program has no such test
inline int RunTests(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  // Files that are compared, of this process and of those that it starts, have one date.
  ::setenv("SOURCE_DATE_EPOCH", "1764000000", /*overwrite=*/0);
  if (argc < 2) return RUN_ALL_TESTS();
  const std::string_view file = argv[1];
  std::string names;
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  for (int i = 0; i < all.total_test_suite_count(); ++i) {
    const testing::TestSuite& suite = *all.GetTestSuite(i);
    for (int j = 0; j < suite.total_test_count(); ++j) {
      const testing::TestInfo& test = *suite.GetTestInfo(j);
      const std::string_view path = test.file();
      const std::string name = std::string(suite.name()) + "." + test.name();
      const auto wanted = [&name](const std::string& part) {
        return part[0] == '-' ? name.find(part.substr(1)) == std::string::npos
                              : name.find(part) != std::string::npos;
      };
      if (path.size() >= file.size() && path.substr(path.size() - file.size()) == file &&
          std::all_of(argv + 2, argv + argc, wanted)) {
        names += name + ":";
      }
    }
  }
  if (names.empty()) {
    std::fprintf(stderr, "no such test of %s is in this program\n", argv[1]);
    return 2;
  }
  testing::GTEST_FLAG(filter) = names;
  return RUN_ALL_TESTS();
}

}  // namespace volalign
