#include "train/distributed/world.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "core/base/file_util.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/tiny_net.h"
#include "train/distributed/flat_module.h"
#include "train/distributed/launch.h"
#include "train/distributed/process_group.h"

namespace volalign::world_test {
namespace {

TEST(ReadWorld, ReadsTheVariablesOfTorchrun) {
  const auto clear = [] {
    for (const char* name : {"WORLD_SIZE", "RANK", "LOCAL_RANK", "MASTER_ADDR", "MASTER_PORT",
                             "TORCHELASTIC_RUN_ID", "VOLALIGN_PORT", "VOLALIGN_STORE"})
      ::unsetenv(name);
  };
  clear();
  EXPECT_EQ(ReadWorld().size, 1);
  ::setenv("WORLD_SIZE", "4", 1);
  ::setenv("RANK", "3", 1);
  ::setenv("LOCAL_RANK", "1", 1);
  ::setenv("MASTER_ADDR", "node0", 1);
  ExpectError<ConfigError>([] { ReadWorld(); }, {"MASTER_PORT"});
  ::setenv("MASTER_PORT", "29500", 1);
  const World world = ReadWorld();
  EXPECT_EQ(world.rank, 3);
  EXPECT_EQ(world.size, 4);
  EXPECT_EQ(world.local_rank, 1);
  EXPECT_EQ(world.address, "node0");
  EXPECT_EQ(world.port, 29500);
  ::setenv("TORCHELASTIC_RUN_ID", "none", 1);  // torchrun's agent listens on 29500
  EXPECT_EQ(ReadWorld().port, 29501);
  ::setenv("VOLALIGN_PORT", "1234", 1);
  EXPECT_EQ(ReadWorld().port, 1234);
  ::setenv("VOLALIGN_STORE", "/tmp/store", 1);
  EXPECT_EQ(ReadWorld().store, "/tmp/store");
  ::setenv("RANK", "4", 1);
  ExpectError<ConfigError>([] { ReadWorld(); }, {"RANK = '4'", "0 to 3"});
  clear();
}

TEST(SliceOf, CoversEachBatchOnce) {
  for (const int size : {1, 2, 3, 4, 7}) {
    int next = 0;
    for (int rank = 0; rank < size; ++rank) {
      const BatchSlice slice = SliceOf(7, rank, size);
      EXPECT_EQ(slice.first, next);
      EXPECT_GE(slice.count, 7 / size);
      EXPECT_LE(slice.count, (7 + size - 1) / size);
      next += slice.count;
    }
    EXPECT_EQ(next, 7);
  }
  ExpectError<ConfigError>([] { SliceOf(7, 0, 8); }, {"run.batch_size = 7", "8 processes"});
}

World At(const std::string& address) {
  World world;
  world.address = address;
  world.port = 29500;
  return world;
}

TEST(AddressTowards, IsTheOneThatTheOtherMachineReaches) {
  EXPECT_EQ(AddressTowards(At("127.0.0.1")), "127.0.0.1");
  // The whole network of a loopback device answers, and is reached from its first address.
  EXPECT_EQ(AddressTowards(At("127.0.0.2")), "127.0.0.1");
  // Broadcasts are not allowed, so that no way leads there.
  ExpectError<IoError>([] { AddressTowards(At("255.255.255.255")); },
                       {"no way", "255.255.255.255"});
}

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
  EXPECT_TRUE(Has(command.at(0), "train_distributed_tests")) << command[0];
}

/// With attention, whose bias is a single number.
TEST(FlatModule, SlotsAreAlignedAndApart) {
  StructureNet net = TinyNet(Normalization::kBatch);
  FlatModule flat(*net);
  const auto address = [](const at::Tensor& t) {
    return reinterpret_cast<std::uintptr_t>(t.data_ptr<float>());
  };
  const auto aligned = [&](const at::Tensor& t) { return address(t) % 64 == 0; };
  std::vector<at::Tensor> parameters = net->parameters();
  std::sort(parameters.begin(), parameters.end(),
            [&](const at::Tensor& a, const at::Tensor& b) { return address(a) < address(b); });
  std::int64_t end = 0, single = 0;
  for (const at::Tensor& p : parameters) {
    const auto offset = static_cast<std::int64_t>((address(p) - address(flat.parameters())) / 4);
    EXPECT_TRUE(aligned(p) && aligned(p.grad())) << offset;
    EXPECT_GE(offset, end);
    EXPECT_EQ(p.dim() > 1, offset < flat.num_weights()) << offset;
    end = offset + p.numel();
    single += p.numel() == 1;
  }
  EXPECT_LE(end, flat.parameters().numel());
  EXPECT_GT(single, 0);
  for (const at::Tensor& b : net->buffers()) EXPECT_TRUE(aligned(b));
}

}  // namespace
}  // namespace volalign::world_test
