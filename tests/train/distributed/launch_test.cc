#include "train/distributed/launch.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "core/base/file_util.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::launch_test {
namespace {

// One that ends badly gives its status, and a signal to the one who waits is passed on.
TEST(LaunchProcesses, WaitsForAllAndSaysHowTheyEnded) {
  const TempFolder folder;
  const std::string write =
      "echo $RANK $LOCAL_RANK $WORLD_SIZE $VOLALIGN_STORE >" + folder.path().string();
  EXPECT_EQ(LaunchProcesses(2, {"/bin/sh", "-c", write + "/$RANK"}), 0);
  std::istringstream first(ReadFile(folder / "0")), second(ReadFile(folder / "1"));
  std::string rank, local, size, store, other_store;
  first >> rank >> local >> size >> store;
  EXPECT_EQ(rank + local + size, "002");
  second >> rank >> local >> size >> other_store;
  EXPECT_EQ(rank + local + size, "112");
  EXPECT_EQ(store, other_store);
  const std::filesystem::path meeting = std::filesystem::path(store).parent_path();
  EXPECT_TRUE(meeting.is_absolute());
  EXPECT_FALSE(std::filesystem::exists(meeting)) << meeting;
  EXPECT_EQ(LaunchProcesses(2, {"/bin/sh", "-c", "exit $((3 * RANK))"}), 3);
  // Rank 1 is killed, and rank 0 gets the time of grace.
  EXPECT_EQ(
      LaunchProcesses(2, {"/bin/sh", "-c", "[ $RANK = 0 ] && exec sleep 60; kill -9 $$"}, 0.2),
      128 + SIGKILL);
  std::thread later([] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    ::kill(::getpid(), SIGTERM);
  });
  testing::internal::CaptureStderr();
  EXPECT_EQ(LaunchProcesses(2, {"/bin/sleep", "60"}), 128 + SIGTERM);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");  // nobody has failed
  later.join();
}

TEST(LaunchProcesses, EndsWhereStatusesWouldBeLost) {
  const auto before = ::signal(SIGCHLD, SIG_IGN);
  EXPECT_EQ(LaunchProcesses(1, {"/bin/sh", "-c", "exit 0"}), 0);
  EXPECT_EQ(LaunchProcesses(1, {"/bin/sh", "-c", "exit 3"}), 3);
  ::signal(SIGCHLD, before);
}

TEST(OwnCommand, IsThisProgramsCommandLine) {
  const std::vector<std::string> command = OwnCommand();
  EXPECT_NE(command.at(0).find("train_distributed_tests"), std::string::npos) << command[0];
}

}  // namespace
}  // namespace volalign::launch_test
