#include "train/distributed/gradient_reducer.h"

#include <ATen/Context.h>
#include <ATen/TensorOperators.h>
#include <ATen/ops/rand.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/core/base/temp_folder.h"
#include "tests/train/distributed/in_processes.h"
#include "tests/train/tiny_net.h"

namespace volalign::gradient_reducer_test {
namespace {

/// A loss that is another one in each rank.
void Backward(StructureNet& net, int rank) {
  at::manual_seed(100 + static_cast<std::uint64_t>(rank));
  net->forward(at::rand({1, 1, 16, 16})).square().sum().backward();
}

TEST(GradientReducer, SumsTheGradientsOfAllProcesses) {
  const TempFolder folder;
  const auto work = [](const World& world) {
    at::manual_seed(1);
    StructureNet net = TinyNet();
    FlatModule flat(*net);
    Backward(net, 0);
    Backward(net, 1);
    const at::Tensor expected = flat.gradients().clone();
    ProcessGroup group;
    group.Connect(world, at::kCPU, 60);
    GradientReducer reducer(&flat, &group, 50);
    if (reducer.num_buckets() < 4) throw Error("one bucket is no test");
    for (int step = 0; step < 2; ++step) {
      flat.gradients().zero_();
      reducer.Arm();
      Backward(net, world.rank);
      reducer.Finish();
      const double error = ((flat.gradients() - expected).norm() / expected.norm()).item<double>();
      if (!(error < 1e-5)) throw Error(fmt::format("step {}: error {}", step, error));
    }
    // Without Arm() nothing is exchanged: the other process does not take part.
    flat.gradients().zero_();
    if (world.rank == 0) Backward(net, 0);
    // What a loss does not depend on is exchanged all the same.
    flat.gradients().zero_();
    reducer.Arm();
    const at::Tensor weights = flat.tensors()[0];
    (weights.sum() * static_cast<double>(world.rank + 1)).backward();
    reducer.Finish();
    const double sum = flat.gradients().sum().item<double>();
    if (sum != 3.0 * static_cast<double>(weights.numel())) throw Error(fmt::format("sum {}", sum));
  };
  EXPECT_EQ(InProcesses(2, folder.path(), work), std::vector<int>(2, 0))
      << ReadFile(folder / "message0");
}

}  // namespace
}  // namespace volalign::gradient_reducer_test
