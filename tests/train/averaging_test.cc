#include "train/averaging.h"

#include <ATen/TensorOperators.h>
#include <gtest/gtest.h>

#include "tests/train/tiny_net.h"

namespace volalign::averaging_test {
namespace {

TEST(WeightAverage, IsARunningMeanWhoseDecayRises) {
  StructureNet net = TinyNet(Normalization::kBatch);
  FlatModule source(*net);
  WeightAverage average(TinyNet(Normalization::kBatch), 0.5, source);
  const auto weight = [&] { return average.net()->parameters()[0].flatten()[0].item<double>(); };
  const auto statistic = [&] { return average.net()->buffers()[0].flatten()[0].item<double>(); };
  const auto fill = [&](double value) {
    source.parameters().fill_(value);
    source.buffers().fill_(value);
  };
  fill(0);
  average.Reset(source);
  fill(11);
  average.Update(source, 1);  // decay (1 + 1) / (10 + 1)
  EXPECT_NEAR(weight(), 9, 1e-5);
  EXPECT_NEAR(statistic(), 9, 1e-5);
  average.Update(source, 1000);  // decay 0.5, the largest
  EXPECT_NEAR(weight(), 10, 1e-5);
  average.Refresh(source);  // nothing, with a decay
  EXPECT_NEAR(weight(), 10, 1e-5);
}

TEST(WeightAverage, WithoutDecayIsTheWeightsOnceTheyAreAskedFor) {
  StructureNet net = TinyNet();
  FlatModule source(*net);
  WeightAverage average(TinyNet(), 0, source);
  const auto weight = [&] { return average.net()->parameters()[0].flatten()[0].item<double>(); };
  const double before = weight();
  source.parameters().fill_(7);
  average.Update(source, 1);
  EXPECT_EQ(weight(), before);
  average.Refresh(source);
  EXPECT_EQ(weight(), 7);
}

}  // namespace
}  // namespace volalign::averaging_test
