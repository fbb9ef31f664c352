#include "core/nn/export_onnx.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/rand.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "core/nn/checkpoint.h"
#include "core/nn/export_torchscript.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/nn/run_check.h"

namespace volalign::export_onnx_test {
namespace {

namespace fs = std::filesystem;

/// A network whose every option shows in its results.
StructureNet RandomNet(const StructureNetOptions& options) {
  StructureNet net(options);
  for (at::Tensor& b : net->buffers()) b.uniform_(0.5, 1.5);
  const c10::NoGradGuard no_grad;
  for (const auto& p : net->named_parameters()) {
    if (p.key().find("bias") != std::string::npos) p.value().uniform_(-0.2, 0.2);
  }
  net->eval();
  return net;
}

// Sizes that are no multiples of 16, among them odd ones, in both orientations; and the least.
const std::vector<std::vector<std::int64_t>> kShapes = {
    {1, 1, 16, 16}, {2, 1, 45, 80}, {1, 1, 143, 161}, {2, 1, 161, 143}};

/// Exports networks of every kind, and has export_onnx_check.py run those files whose names end so.
void ExpectSameByOthers(const std::string& ending) {
  const TempFolder folder;
  const c10::NoGradGuard no_grad;
  std::vector<at::Tensor> depths;
  for (std::size_t i = 0; i < kShapes.size(); ++i) {
    // Holes, and values beyond the clamp.
    depths.push_back(at::rand(kShapes[i]) * 9 * (at::rand(kShapes[i]) > 0.2));
    testing_nn::WriteValues(folder.path(), fmt::format("depth{}", i), depths.back());
  }
  for (const Normalization normalization : AllOf(Normalization())) {
    for (const InputEncoding input : AllOf(InputEncoding())) {
      CheckpointMeta meta;
      meta.structure = ReadStructure("configs/structure.yaml");
      meta.network.base_channels = 3;
      meta.network.residual_blocks = 2;
      meta.network.normalization = normalization;
      meta.network.input = input;
      meta.network.attention = input == InputEncoding::kDepth;
      meta.roll_offsets_deg = {90};
      const std::string name = fmt::format("{}_{}", ToString(normalization), ToString(input));
      const fs::path checkpoint = folder / (name + ".safetensors");
      // What is tested is the export: rounding the weights beforehand leaves it nothing to round.
      SaveCheckpoint(checkpoint, RandomNet(meta.network), meta, /*half=*/true);
      StructureNet net = LoadCheckpoint(checkpoint).net;
      for (const bool half : {false, true}) {
        const std::string precision = half ? ".fp16" : ".fp32";
        const fs::path exported = folder / (name + precision + ending);
        if (ending == ".ts") {
          ExportTorchScript(checkpoint, exported, half);
        } else {
          ExportOnnx(checkpoint, exported, half);
        }
      }
      for (std::size_t i = 0; i < depths.size(); ++i)
        testing_nn::WriteValues(folder.path(), fmt::format("{}.expected{}", name, i),
                                net->forward(EncodeDepth(depths[i], input)));
    }
  }
  EXPECT_EQ(
      testing_nn::RunCheck(VOLALIGN_PYTHON, "tests/core/nn/export_onnx_check.py", folder.path()),
      0);
}

TEST(ExportOnnx, RunsByOnnxRuntime) { ExpectSameByOthers(".onnx"); }

TEST(ExportTorchScript, RunsByPyTorch) { ExpectSameByOthers(".ts"); }

TEST(ExportOnnx, GivesTheSameBytes) {
  const TempFolder folder;
  ExportOnnx("models/m05-lite.safetensors", folder / "fresh.onnx", true);
  EXPECT_TRUE(ReadFile(folder / "fresh.onnx") == ReadFile("models/m05-lite.onnx"))
      << "volalign export --model models/m05-lite.safetensors --format onnx --precision fp16 -o "
         "models/m05-lite.onnx";
}

TEST(ExportOnnx, WritesNothingWhereItFails) {
  const TempFolder folder;
  const fs::path missing = folder / "missing.safetensors", out = folder / "x";
  ExpectError<IoError>([&] { ExportOnnx(missing, out, false); }, {"missing.safetensors"});
  ExpectError<IoError>([&] { ExportTorchScript(missing, out); }, {"missing.safetensors"});
  EXPECT_FALSE(fs::exists(out));
}

}  // namespace
}  // namespace volalign::export_onnx_test
