#include "train/distributed/process_group.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/full.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/core/base/temp_folder.h"
#include "tests/train/distributed/in_processes.h"

namespace volalign::process_group_test {
namespace {

void Require(bool holds, const char* what) {
  if (!holds) throw Error(what);
}

TEST(ProcessGroup, AloneDoesNothing) {
  ProcessGroup group;
  EXPECT_TRUE(group.leads());
  EXPECT_EQ(group.size(), 1);
  const at::Tensor tensor = at::full({2}, 3.0);
  group.Sum(tensor);
  group.Broadcast(tensor);
  group.BeginSum(tensor)();
  EXPECT_TRUE(tensor.equal(at::full({2}, 3.0)));
  EXPECT_EQ(group.Gather("own"), std::vector<std::string>{"own"});
  EXPECT_EQ(group.FromLead([] { return std::string("made"); }), "made");
}

TEST(ProcessGroup, SumsBroadcastsAndGathers) {
  if (!ProcessGroup::IsBuilt()) GTEST_SKIP() << "this build has no Gloo";
  const TempFolder folder;
  const auto work = [](const World& world) {
    ProcessGroup group;
    group.Connect(world, at::kCPU, 60);
    Require(group.rank() == world.rank && group.size() == 3, "rank and size");
    Require(group.leads() == (world.rank == 0), "lead");
    const at::Tensor sum = at::full({2}, world.rank + 1.0);
    group.Sum(sum);
    Require(sum.equal(at::full({2}, 6.0)), "sum");
    const at::Tensor first = at::full({2}, world.rank + 1.0), second = at::full({1}, 1.0);
    const auto wait_first = group.BeginSum(first), wait_second = group.BeginSum(second);
    wait_first();
    wait_second();
    Require(first.equal(at::full({2}, 6.0)) && second.equal(at::full({1}, 3.0)), "two at once");
    const at::Tensor same = at::full({2}, world.rank + 7.0);
    group.Broadcast(same);
    Require(same.equal(at::full({2}, 7.0)), "broadcast");
    const std::string own(static_cast<std::size_t>(world.rank), 'x');  // of different lengths
    Require(group.Gather(own) == std::vector<std::string>{"", "x", "xx"}, "gather");
    const std::string made = group.FromLead([&] { return std::to_string(world.rank); });
    Require(made == "0", "from lead");
    group.FromLead([]() -> std::string { throw Error("the lead failed"); });
  };
  EXPECT_EQ(InProcesses(3, folder.path(), work), std::vector<int>(3, 1));
  EXPECT_EQ(ReadFile(folder / "message0"), "the lead failed");
  for (const char* other : {"message1", "message2"})
    EXPECT_EQ(ReadFile(folder / other), "rank 0: the lead failed");
}

}  // namespace
}  // namespace volalign::process_group_test
