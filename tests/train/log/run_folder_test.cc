#include "train/log/run_folder.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

#include "tests/core/base/temp_folder.h"

namespace volalign::run_folder_test {
namespace {

namespace fs = std::filesystem;

void Touch(const fs::path& path) { std::ofstream(path) << "x"; }

TEST(RunFolder, KeepsTheNewestStates) {
  const TempFolder folder;
  const RunFolder run(folder / "a/b");
  for (const int samples : {9, 1000, 20}) Touch(run.State(samples));
  Touch(run.dir() / "states" / "notes.txt");
  Touch(run.dir() / "states" / "12.pt");
  EXPECT_EQ(run.States(), (std::vector<std::int64_t>{1000, 20, 9}));
  run.KeepStates(2);
  EXPECT_EQ(run.States(), (std::vector<std::int64_t>{1000, 20}));
  EXPECT_TRUE(fs::exists(run.dir() / "states" / "notes.txt"));
}

TEST(RunFolder, BeginsAfterAStateWithoutWhatCameLaterOrWasNotFinished) {
  const TempFolder folder;
  const RunFolder run(folder / "run");
  for (const int samples : {10, 20, 30}) Touch(run.State(samples));
  const fs::path half_state = run.State(30).string() + ".tmp-1",
                 half_model = run.model().string() + ".tmp-1";
  for (const fs::path& path : {half_state, half_model, run.model(), run.dir() / "own.tmp-1"})
    Touch(path);
  run.BeginAfter(20);
  EXPECT_EQ(run.States(), (std::vector<std::int64_t>{20, 10}));
  EXPECT_FALSE(fs::exists(half_state));
  EXPECT_FALSE(fs::exists(half_model));
  EXPECT_TRUE(fs::exists(run.model()));
  EXPECT_TRUE(fs::exists(run.dir() / "own.tmp-1"));  // nothing that a run writes
}

}  // namespace
}  // namespace volalign::run_folder_test
