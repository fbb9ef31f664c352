#include "train/distributed/flat_module.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/rand.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <string>

#include "tests/train/tiny_net.h"

namespace volalign::flat_module_test {
namespace {

TEST(FlatModule, KeepsValuesAndCollectsGradients) {
  StructureNet net = TinyNet(Normalization::kBatch);
  std::map<std::string, at::Tensor> before;
  for (const auto& p : net->named_parameters()) before[p.key()] = p.value().detach().clone();
  FlatModule flat(*net);
  EXPECT_EQ(flat.tensors().size(), before.size());
  std::map<std::string, at::Tensor> views;
  flat.AddViews(flat.parameters(), "x/", &views);
  ASSERT_EQ(views.size(), before.size());
  for (const auto& [name, value] : before) EXPECT_TRUE(views.at("x/" + name).equal(value)) << name;

  net->forward(at::rand({2, 1, 16, 16})).square().sum().backward();
  double squares = 0;
  for (const at::Tensor& p : net->parameters()) squares += p.grad().square().sum().item<double>();
  EXPECT_GT(squares, 0);
  EXPECT_NEAR(flat.gradients().square().sum().item<double>() / squares, 1, 1e-5);
  const at::Tensor mean = net->named_buffers()["encoder1_1.running_mean"];
  EXPECT_NE(mean.abs().max().item<double>(), 0);  // the statistics moved with the forward pass
  flat.buffers().fill_(7);
  EXPECT_EQ(mean[0].item<double>(), 7);
}

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
