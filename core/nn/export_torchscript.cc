#include "core/nn/export_torchscript.h"

#include <ATen/core/Tensor.h>
#include <fmt/format.h>
#include <torch/csrc/jit/api/module.h>

#include <algorithm>
#include <map>
#include <sstream>
#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/model/paper_units.h"
#include "core/nn/checkpoint.h"

namespace volalign {
namespace {

/// Writes MakePaperNet as TorchScript over tensors named UNIT_PARAMETER. A value is a variable.
class ScriptWriter {
 public:
  using Value = std::string;

  ScriptWriter(const StructureNetOptions& options, bool half)
      : options_(options), widen_(half ? ".float()" : "") {}

  std::string Write() {
    Line("def forward(self, depth: Tensor) -> Tensor:", 0);
    Line("assert depth.dim() == 4 and depth.size(1) == 1, 'depth must be [B,1,H,W], metres'");
    std::string x = "depth";
    if (options_.input == InputEncoding::kDepthMask) {
      Line("valid = (depth > 0).to(depth.dtype)");
      x = Set("encoded", fmt::format("torch.cat([(torch.clamp(depth, max={:.1f}) - {:.1f}) * "
                                     "valid, valid], 1)",
                                     kDepthClamp, kDepthCentre));
    }
    Line("return torch.log_softmax(" + MakePaperNet(options_, *this, x) + ", 1)");
    return source_;
  }

  std::string Op(PaperOp op, const std::string& name, const std::string& x,
                 const std::string& y = "") {
    static const std::map<PaperOp, const char*> functions = {
        {PaperOp::kRelu, "torch.relu({})"},
        {PaperOp::kPool, "torch.max_pool2d({}, [2, 2])"},
        {PaperOp::kSigmoid, "torch.sigmoid({})"},
        {PaperOp::kAdd, "{} + {}"},
        {PaperOp::kMultiply, "{} * {}"},
        {PaperOp::kConcatenate, "torch.cat([{}, {}], 1)"},
        {PaperOp::kSizeOf, "[{0}.size(2), {0}.size(3)]"},
        {PaperOp::kEnlarge, "torch.upsample_nearest2d({}, {})"}};
    return Set(name, fmt::format(fmt::runtime(functions.at(op)), x, y));
  }

  std::string UnitOfEnlarged(const PaperUnit& unit, const std::string& name, const std::string& x,
                             const std::string& size) {
    return Unit(unit, Op(PaperOp::kEnlarge, name, x, size));
  }

  std::string Unit(const PaperUnit& unit, const std::string& x) {
    const std::string name = "self." + unit.name + "_";
    const bool normalized = unit.normalization != Normalization::kNone;
    std::string y =
        fmt::format("torch.conv2d({0}, {1}weight{2}, {3}, [1, 1], [{4}, {4}])", x, name, widen_,
                    normalized ? "None" : name + "bias" + widen_, unit.kernel / 2);
    const std::string affine = fmt::format("{0}norm_weight{1}, {0}norm_bias{1}", name, widen_);
    if (unit.normalization == Normalization::kBatch) {
      y = fmt::format(
          "torch.batch_norm({0}, {1}, {2}running_mean, {2}running_var, False, 0.0, {3}, True)", y,
          affine, name, kNormEpsilon);
    } else if (normalized) {
      y = fmt::format("torch.group_norm({}, {}, {}, {})", y, NormGroups(unit.out), affine,
                      kNormEpsilon);
    }
    return Set(unit.name, unit.relu ? "torch.relu(" + y + ")" : y);
  }

 private:
  void Line(const std::string& text, int indent = 4) {
    source_ += std::string(static_cast<std::size_t>(indent), ' ') + text + "\n";
  }

  /// Returns the variable.
  std::string Set(std::string name, const std::string& value) {
    std::replace(name.begin(), name.end(), '.', '_');
    Line(name + " = " + value);
    return name;
  }

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
  script.define(ScriptWriter(model.meta.network, half).Write());
  script.eval();
  std::ostringstream bytes;
  script.save(bytes, {{"volalign.json", MetaToJson(model.meta)}});
  WriteFileAtomically(output, bytes.str());
}

}  // namespace volalign
