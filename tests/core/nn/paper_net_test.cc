#include "core/nn/paper_net.h"

#include <gtest/gtest.h>

#include <map>
#include <string>

#include "core/model/paper_units.h"
#include "core/nn/checkpoint.h"

namespace volalign::paper_net_test {
namespace {

TEST(PaperNetShapes, AreThoseOfTheNetwork) {
  for (const Normalization normalization : AllOf(Normalization())) {
    for (const bool all : {false, true}) {
      StructureNetOptions options;
      options.base_channels = 2;
      options.residual_blocks = all ? 2 : 0;
      options.attention = all;
      options.input = all ? InputEncoding::kDepthMask : InputEncoding::kDepth;
      options.normalization = normalization;
      std::map<std::string, at::Tensor> tensors;
      AddModuleTensors(*StructureNet(options), "", &tensors);
      const auto shapes = PaperNetShapes(options);
      ASSERT_EQ(shapes.size(), tensors.size());
      for (const auto& [name, shape] : shapes) EXPECT_EQ(tensors.at(name).sizes(), shape) << name;
    }
  }
}

}  // namespace
}  // namespace volalign::paper_net_test
