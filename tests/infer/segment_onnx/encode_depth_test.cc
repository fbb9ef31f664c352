#include "infer/segment_onnx/encode_depth.h"

#include <ATen/ops/from_blob.h>
#include <gtest/gtest.h>

#include <vector>

#include "core/nn/network.h"

namespace volalign::encode_depth_test {
namespace {

TEST(EncodeDepth, IsThatOfTheNetworkInLibTorch) {
  DepthImage depth(3, 2);
  const std::vector<float> values = {0, 0.3f, 2, 5.9999f, 6, 16};
  std::copy(values.begin(), values.end(), depth.begin());
  const at::Tensor tensor = at::from_blob(depth.data(), {1, 1, 2, 3}, at::kFloat);
  for (const InputEncoding input : AllOf(InputEncoding())) {
    const std::vector<float> ours = EncodeDepth(depth, input);
    const at::Tensor theirs = EncodeDepth(tensor, input).contiguous();
    ASSERT_EQ(ours.size(), static_cast<std::size_t>(theirs.numel()));
    for (std::size_t i = 0; i < ours.size(); ++i)
      EXPECT_EQ(ours[i], theirs.data_ptr<float>()[i]) << ToString(input) << " " << i;
  }
}

}  // namespace
}  // namespace volalign::encode_depth_test
