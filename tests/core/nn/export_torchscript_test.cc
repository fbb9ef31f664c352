#include "core/nn/export_torchscript.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/rand.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>
#include <torch/csrc/jit/api/module.h>
#include <torch/csrc/jit/serialization/import.h>

#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "core/nn/checkpoint.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::export_torchscript_test {
namespace {

namespace fs = std::filesystem;

/// A depth-like map with holes and far values.
at::Tensor Depth(int height, int width) {
  const at::Tensor depth = at::rand({2, 1, height, width}) * 9;
  return depth * (at::rand({2, 1, height, width}) > 0.2);
}

TEST(ExportTorchScript, GivesTheSameLogProbabilities) {
  const TempFolder folder;
  c10::NoGradGuard no_grad;
  for (const auto normalization :
       {Normalization::kNone, Normalization::kBatch, Normalization::kGroup}) {
    for (const auto input : {InputEncoding::kDepth, InputEncoding::kDepthMask}) {
      CheckpointMeta meta;
      meta.structure = ReadStructure("configs/structure.yaml");
      meta.network.base_channels = 2;
      meta.network.residual_blocks = 2;
      meta.network.normalization = normalization;
      meta.network.input = input;
      meta.network.attention = input == InputEncoding::kDepth;
      meta.network.background_bias = 1;
      StructureNet net(meta.network);
      for (at::Tensor& b : net->buffers()) b.uniform_(0.5, 1.5);
      SaveCheckpoint(folder / "model.safetensors", net, meta, false);
      ExportTorchScript(folder / "model.safetensors", folder / "model.ts");
      torch::jit::ExtraFilesMap extra{{"volalign.json", ""}};
      torch::jit::Module script = torch::jit::load((folder / "model.ts").string(), at::kCPU, extra);
      EXPECT_TRUE(Has(extra["volalign.json"], "\"top/front\""));
      net->eval();
      const std::vector<std::pair<int, int>> sizes = {{16, 16}, {45, 80}, {33, 47}, {144, 160}};
      for (const auto& [height, width] : sizes) {
        const at::Tensor depth = Depth(height, width);
        const at::Tensor ours = net->forward(EncodeDepth(depth, input));
        const at::Tensor theirs = script.forward({depth}).toTensor();
        ASSERT_EQ(theirs.sizes(), ours.sizes());
        EXPECT_TRUE((theirs - ours).abs().max().item<double>() < 1e-4)
            << ToString(normalization) << " " << ToString(input) << " " << height << "x" << width;
      }
    }
  }
  ExpectError<IoError>([&] { ExportTorchScript(folder / "missing.safetensors", folder / "x.ts"); },
                       {"missing.safetensors"});
  EXPECT_FALSE(fs::exists(folder / "x.ts"));
}

}  // namespace
}  // namespace volalign::export_torchscript_test
