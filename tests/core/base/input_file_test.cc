#include "core/base/input_file.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <string>

#include "tests/core/base/temp_folder.h"

namespace volalign::input_file_test {
namespace {

namespace fs = std::filesystem;

TEST(InputFile, DataStandAboveAProgramOrInShareBesideIt) {
  ::unsetenv("VOLALIGN_DATA_DIR");
  const TempFolder folder;
  const auto make = [&](const std::string& data) {
    fs::create_directories(folder / data / "configs");
    folder.Write(data + "/configs/structure.yaml", "");
  };
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), "");
  make("prefix/share/volalign");
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), folder / "prefix/share/volalign");
  make("prefix/bin/tree");
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/tree/build/program"), folder / "prefix/bin/tree")
      << "the nearest";
  make("named");
  ::setenv("VOLALIGN_DATA_DIR", (folder / "named").c_str(), 1);
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), folder / "named");
  ::setenv("VOLALIGN_DATA_DIR", folder.path().c_str(), 1);
  EXPECT_EQ(DataFolderNear(folder / "prefix/bin/program"), folder / "prefix/share/volalign")
      << "one that has no data does not count";
  ::unsetenv("VOLALIGN_DATA_DIR");
}

}  // namespace
}  // namespace volalign::input_file_test
