#include "train/distributed/flat_module.h"

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/train/tiny_net.h"

namespace volalign::flat_module_test {
namespace {

/// With attention, whose bias is a single number.
TEST(FlatModule, SlotsAreAlignedAndApart) {
  StructureNet net = TinyNet(Normalization::kBatch);
  FlatModule flat(*net);
  const auto address = [](const at::Tensor& t) {
    return reinterpret_cast<std::uintptr_t>(t.data_ptr<float>());
  };
  const auto aligned = [&](const at::Tensor& t) { return address(t) % 64 == 0; };
  std::int64_t end = 0, single = 0;
  for (std::size_t i = 0; i < flat.tensors().size(); ++i) {
    const at::Tensor& p = flat.tensors()[i];
    EXPECT_TRUE(aligned(p) && aligned(p.grad())) << i;
    EXPECT_EQ(address(p) - address(flat.parameters()), 4u * flat.offset(i));
    EXPECT_GE(flat.offset(i), end);
    EXPECT_EQ(p.dim() > 1, flat.offset(i) < flat.num_weights()) << i;
    end = flat.offset(i) + p.numel();
    single += p.numel() == 1;
  }
  EXPECT_GT(single, 0);
  for (const at::Tensor& b : net->buffers()) EXPECT_TRUE(aligned(b));
}

}  // namespace
}  // namespace volalign::flat_module_test
