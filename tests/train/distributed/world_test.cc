#include "train/distributed/world.h"

#include <gtest/gtest.h>

#include <map>
#include <string>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::world_test {
namespace {

TEST(ReadWorld, ReadsTheVariablesOfTorchrun) {
  std::map<std::string, std::string> set;
  const Environment environment = [&](const std::string& name) -> std::optional<std::string> {
    const auto found = set.find(name);
    if (found == set.end()) return std::nullopt;
    return found->second;
  };
  EXPECT_EQ(ReadWorld(environment).size, 1);
  set = {{"WORLD_SIZE", "4"}, {"RANK", "3"}, {"LOCAL_RANK", "1"}, {"MASTER_ADDR", "node0"}};
  ExpectError<ConfigError>([&] { ReadWorld(environment); }, {"MASTER_PORT"});
  set["MASTER_PORT"] = "29500";
  World world = ReadWorld(environment);
  EXPECT_EQ(world.rank, 3);
  EXPECT_EQ(world.size, 4);
  EXPECT_EQ(world.local_rank, 1);
  EXPECT_EQ(world.address, "node0");
  EXPECT_EQ(world.port, 29500);
  set["TORCHELASTIC_RUN_ID"] = "none";  // torchrun's agent listens on 29500
  EXPECT_EQ(ReadWorld(environment).port, 29501);
  set["VOLALIGN_PORT"] = "1234";
  EXPECT_EQ(ReadWorld(environment).port, 1234);
  set["VOLALIGN_STORE"] = "/tmp/store";
  EXPECT_EQ(ReadWorld(environment).store, "/tmp/store");
  set["RANK"] = "4";
  ExpectError<ConfigError>([&] { ReadWorld(environment); }, {"RANK = '4'", "0 to 3"});
}

TEST(SliceOf, CoversEachBatchOnce) {
  for (const int size : {1, 2, 3, 4, 7}) {
    int next = 0;
    for (int rank = 0; rank < size; ++rank) {
      World world;
      world.rank = rank;
      world.size = size;
      const BatchSlice slice = SliceOf(7, world);
      EXPECT_EQ(slice.first, next);
      EXPECT_GE(slice.count, 7 / size);
      EXPECT_LE(slice.count, (7 + size - 1) / size);
      next += slice.count;
    }
    EXPECT_EQ(next, 7);
  }
  World crowd;
  crowd.size = 8;
  ExpectError<ConfigError>([&] { SliceOf(7, crowd); }, {"run.batch_size = 7", "8 processes"});
}

}  // namespace
}  // namespace volalign::world_test
