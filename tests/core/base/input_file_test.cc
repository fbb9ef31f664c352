#include "core/base/input_file.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
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

// So that a program of somebody else's, which sets none, finds them as volalign does.
TEST(InputFile, DataAreLookedForNearTheRunningProgramUnlessItSaysOtherwise) {
  EXPECT_EQ(DataFolder(), fs::current_path());
  EXPECT_EQ(FindInputFile("configs/m01.yaml"), "configs/m01.yaml");
  const std::string before = DataFolder();
  SetDataFolder("");
  ExpectError<IoError>([] { RequireInputFile("data.structure", "configs/none.yaml"); },
                       {"data.structure = configs/none.yaml", "VOLALIGN_DATA_DIR"});
  SetDataFolder(before);
}

}  // namespace
}  // namespace volalign::input_file_test
