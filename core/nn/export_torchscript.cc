#include "core/nn/export_torchscript.h"

#include <ATen/core/Tensor.h>
#include <fmt/format.h>
#include <torch/csrc/jit/api/module.h>

#include <map>
#include <sstream>
#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/model/paper_units.h"
#include "core/nn/checkpoint.h"

namespace volalign {
namespace {

/// Writes PaperNetImpl::forward (core/nn/paper_net.cc) as TorchScript over tensors named
/// UNIT_PARAMETER.
class ScriptWriter {
 public:
  ScriptWriter(const StructureNet& net, bool half)
      : net_(net), options_(net->options()), widen_(half ? ".float()" : "") {}

  std::string Write() {
    Line("def forward(self, depth: Tensor) -> Tensor:", 0);
    Line("assert depth.dim() == 4 and depth.size(1) == 1, 'depth must be [B,1,H,W], metres'");
    if (options_.input == InputEncoding::kDepth) {
      Line("x = depth");
    } else {
      Line("valid = (depth > 0).to(depth.dtype)");
      Line(fmt::format(
          "x = torch.cat([(torch.clamp(depth, max={:.1f}) - {:.1f}) * valid, valid], 1)",
          kDepthClamp, kDepthCentre));
    }
    for (std::size_t g = 1; g <= EncoderGroups().size(); ++g) {
      if (g > 1) {
        Line(fmt::format("skip{} = x", g - 1));
        Line("x = torch.max_pool2d(x, [2, 2])");
      }
      for (int i = 1; i <= EncoderGroups()[g - 1]; ++i) {
        Line("x = torch.relu(" + Unit(fmt::format("encoder{}_{}", g, i), "x") + ")");
      }
    }
    for (int i = 1; i <= options_.residual_blocks; ++i) {
      Line("y = torch.relu(" + Unit(fmt::format("residual{}_1", i), "torch.relu(x)") + ")");
      Line("x = x + " + Unit(fmt::format("residual{}_2", i), "y"));
    }
    if (options_.attention) {
      Line("mask = torch.sigmoid(" + Unit("attention", "x") + ")");
      Line("x = x * mask");
    }
    for (int level = 4; level >= 1; --level) {
      for (int i = 1; i <= 2; ++i) {
        Line("x = torch.relu(" + Unit(fmt::format("decoder{}_{}", level, i), "x") + ")");
      }
      const std::string size = fmt::format("[skip{0}.size(2), skip{0}.size(3)]", level);
      Line("x = torch.upsample_nearest2d(x, " + size + ")");
      Line("x = torch.relu(" + Unit(fmt::format("decoder{}_3", level), "x") + ")");
      Line("x = torch.relu(" +
           Unit(fmt::format("merge{}", level), fmt::format("torch.cat([x, skip{}], 1)", level)) +
           ")");
      if (options_.attention) Line("x = x * torch.upsample_nearest2d(mask, " + size + ")");
    }
    Line("x = torch.relu(" + Unit("decoder0_1", "x") + ")");
    Line("return torch.log_softmax(" + Unit("classifier", "x") + ", 1)");
    return source_;
  }

 private:
  void Line(const std::string& text, int indent = 4) {
    source_ += std::string(static_cast<std::size_t>(indent), ' ') + text + "\n";
  }

  std::string Unit(const std::string& name, const std::string& x) const {
    const auto parameters = net_->named_children()[name]->named_parameters(false);
    const std::int64_t padding = parameters["weight"].size(2) / 2;
    std::string conv = fmt::format(
        "torch.conv2d({0}, self.{1}_weight{4}, {2}, [1, 1], [{3}, {3}])", x, name,
        parameters.contains("bias") ? "self." + name + "_bias" + widen_ : std::string("None"),
        padding, widen_);
    if (!parameters.contains("norm_weight")) return conv;
    const std::string affine =
        fmt::format("self.{0}_norm_weight{1}, self.{0}_norm_bias{1}", name, widen_);
    if (options_.normalization == Normalization::kBatch) {
      return fmt::format(
          "torch.batch_norm({0}, {1}, self.{2}_running_mean, self.{2}_running_var, False, 0.0, "
          "{3}, True)",
          conv, affine, name, kNormEpsilon);
    }
    return fmt::format("torch.group_norm({}, {}, {}, {})", conv,
                       NormGroups(parameters["weight"].size(0)), affine, kNormEpsilon);
  }

  const StructureNet& net_;
  const StructureNetOptions& options_;
  const std::string widen_;
  std::string source_;
};

}  // namespace

void ExportTorchScript(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                       bool half) {
  const LoadedModel model = LoadCheckpoint(checkpoint);
  RequirePaperNet(model.meta, checkpoint.string());
  const std::map<std::string, at::Tensor> tensors =
      NetworkTensors(model.net, half, checkpoint.string());
  torch::jit::Module script("StructureNet");
  for (const auto& unit : model.net->named_children()) {
    for (const auto& p : unit.value()->named_parameters(false)) {
      script.register_parameter(unit.key() + "_" + p.key(),
                                tensors.at(unit.key() + "." + p.key()).detach(),
                                /*is_buffer=*/false);
    }
    for (const auto& b : unit.value()->named_buffers(false)) {
      script.register_parameter(unit.key() + "_" + b.key(), b.value(), /*is_buffer=*/true);
    }
  }
  script.define(ScriptWriter(model.net, half).Write());
  script.eval();
  std::ostringstream bytes;
  script.save(bytes, {{"volalign.json", MetaToJson(model.meta)}});
  WriteFileAtomically(output, bytes.str());
}

}  // namespace volalign
