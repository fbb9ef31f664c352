#include <ATen/TensorOperators.h>
#include <ATen/ops/batch_norm.h>
#include <ATen/ops/cat.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/group_norm.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/max_pool2d.h>
#include <ATen/ops/ones.h>
#include <ATen/ops/relu.h>
#include <ATen/ops/sigmoid.h>
#include <ATen/ops/upsample_nearest2d.h>
#include <ATen/ops/zeros.h>
#include <c10/core/GradMode.h>
#include <torch/csrc/autograd/generated/variable_factories.h>

#include <cmath>
#include <map>
#include <string>

#include "core/base/error.h"
#include "core/model/paper_units.h"
#include "core/nn/cpu/convolution.h"
#include "core/nn/cpu/winograd.h"
#include "core/nn/network.h"

namespace volalign {
namespace {

/// A weight [out,in,k,k] with Xavier's uniform initialisation (Glorot and Bengio 2010):
/// U(-a, a), a = sqrt(6 / (fan_in + fan_out)).
at::Tensor XavierWeight(int in, int out, int kernel) {
  const double bound = std::sqrt(6.0 / ((in + out) * kernel * kernel));
  at::Tensor weight = torch::empty({out, in, kernel, kernel});
  c10::NoGradGuard no_grad;
  weight.uniform_(-bound, bound);
  return weight;
}

bool IsTwice(const at::Tensor& like, const at::Tensor& x) {
  return like.size(2) == 2 * x.size(2) && like.size(3) == 2 * x.size(3);
}

at::Tensor UpsampleTo(const at::Tensor& x, const at::Tensor& like) {
  if (x.size(2) == like.size(2) && x.size(3) == like.size(3)) return x;
  return at::upsample_nearest2d(x, {like.size(2), like.size(3)});
}

/// A convolution, then normalisation if there is one. Parameters: `weight` [out,in,k,k] and `bias`
/// [out] (absent before a normalisation, which would cancel it). A normalisation adds `norm_weight`
/// and `norm_bias` [out], and with kBatch the buffers `running_mean` and `running_var` [out].
class ConvUnitImpl : public torch::nn::Module {
 public:
  explicit ConvUnitImpl(const PaperUnit& unit) : normalization_(unit.normalization) {
    weight_ = register_parameter("weight", XavierWeight(unit.in, unit.out, unit.kernel));
    if (normalization_ == Normalization::kNone) {
      bias_ = register_parameter("bias", torch::zeros({unit.out}));
      return;
    }
    norm_weight_ = register_parameter("norm_weight", torch::ones({unit.out}));
    norm_bias_ = register_parameter("norm_bias", torch::zeros({unit.out}));
    if (normalization_ == Normalization::kBatch) {
      running_mean_ = register_buffer("running_mean", torch::zeros({unit.out}));
      running_var_ = register_buffer("running_var", torch::ones({unit.out}));
    }
  }

  /// x [B,in,H,W] -> [B,out,H,W] in `dtype`. In training on a CPU by Winograd's algorithm if that
  /// is faster (WinogradSuits).
  at::Tensor forward(const at::Tensor& x, at::ScalarType dtype) {
    if (!IsTrained() || !WinogradSuits(x, weight_, dtype))
      return Normalize(Convolve(x, weight_, dtype, weight_.size(2) / 2, bias_), dtype);
    at::Tensor y = WinogradConvolve(x, weight_, dtype);
    if (bias_.defined()) y.add_(bias_.to(dtype).view({1, -1, 1, 1}));
    return Normalize(y, dtype);
  }

  /// The same of x enlarged to the size of `like` by repetition.
  at::Tensor ForwardEnlarged(const at::Tensor& x, const at::Tensor& like, at::ScalarType dtype) {
    const bool channels_last = x.is_cpu() && x.is_contiguous(at::MemoryFormat::ChannelsLast);
    if (!IsTrained() || !channels_last || !IsTwice(like, x))
      return forward(UpsampleTo(x, like), dtype);
    const at::Tensor phase_weight = PhaseWeight(weight_);
    at::Tensor y = FromPhases(WinogradSuits(x, phase_weight, dtype)
                                  ? WinogradConvolve(x, phase_weight, dtype)
                                  : Convolve(x, phase_weight, dtype, /*padding=*/1));
    if (bias_.defined()) y = y + bias_.to(dtype).view({1, -1, 1, 1});
    return Normalize(y, dtype);
  }

 private:
  bool IsTrained() const { return is_training() && c10::GradMode::is_enabled(); }

  at::Tensor Normalize(const at::Tensor& y, at::ScalarType dtype) {
    switch (normalization_) {
      case Normalization::kNone:
        return y;
      case Normalization::kBatch:
        return at::batch_norm(y, norm_weight_, norm_bias_, running_mean_, running_var_,
                              is_training(), kNormMomentum, kNormEpsilon, /*cudnn_enabled=*/true);
      case Normalization::kGroup:
        return at::group_norm(y.to(at::kFloat), NormGroups(weight_.size(0)), norm_weight_,
                              norm_bias_, kNormEpsilon)
            .to(dtype);
    }
    throw Error("invalid Normalization");
  }

  Normalization normalization_;
  at::Tensor weight_, bias_, norm_weight_, norm_bias_, running_mean_, running_var_;
};
TORCH_MODULE(ConvUnit);

/// Computes MakePaperNet. In bfloat16 the first convolution, the normalisation statistics, the mask
/// and the log-softmax stay float32.
struct TensorMaker {
  using Value = at::Tensor;
  std::map<std::string, ConvUnit>& units;
  at::ScalarType type;
  at::Tensor mask = {};  ///< [B,1,H/16,W/16]

  /// The type bfloat16 has no number between 0.996 and 1, and a mask that is rounded to 1 has no
  /// gradient.
  at::ScalarType TypeOf(const PaperUnit& unit) const {
    return unit.name == "encoder1_1" || unit.name == "attention" ? at::kFloat : type;
  }
  at::Tensor Unit(const PaperUnit& unit, const at::Tensor& x) const {
    const at::Tensor y = units.at(unit.name)->forward(x, TypeOf(unit));
    return unit.relu ? y.relu_().to(type) : y;
  }
  at::Tensor UnitOfEnlarged(const PaperUnit& unit, const std::string&, const at::Tensor& x,
                            const at::Tensor& like) const {
    return units.at(unit.name)->ForwardEnlarged(x, like, type).relu_();
  }
  at::Tensor Op(PaperOp op, const std::string&, const at::Tensor& x, const at::Tensor& y = {}) {
    switch (op) {
      case PaperOp::kRelu:
        return at::relu(x);
      case PaperOp::kPool:
        return at::max_pool2d(x, {2, 2});
      case PaperOp::kSigmoid:
        return mask = at::sigmoid(x);
      case PaperOp::kAdd:
        return x + y;
      case PaperOp::kMultiply:
        return x * y.to(type);
      case PaperOp::kConcatenate:
        return at::cat({x, y}, 1);
      case PaperOp::kSizeOf:
        return x;
      case PaperOp::kEnlarge:
        return UpsampleTo(x, y);
    }
    throw Error("invalid PaperOp");
  }
};

class PaperNet : public StructureNetImpl {
 public:
  explicit PaperNet(const StructureNetOptions& options) : StructureNetImpl(options) {
    for (const PaperUnit& unit : PaperUnits(options))
      units_.emplace(unit.name, register_module(unit.name, ConvUnit(unit)));
    c10::NoGradGuard no_grad;
    units_.at("classifier")->parameters().at(1).select(0, 0).fill_(options.background_bias);
  }

  NetworkOutput ForwardWithAttention(const at::Tensor& input) override {
    RequireInput(input);
    TensorMaker maker{units_, compute_type()};
    const at::Tensor logits = MakePaperNet(
        options(), maker, channels_last() && is_training() ? ChannelsLast(input) : input);
    return {at::log_softmax(logits.to(at::kFloat), 1), maker.mask};
  }

 private:
  std::map<std::string, ConvUnit> units_;
};

}  // namespace

std::shared_ptr<StructureNetImpl> NewPaperNet(const StructureNetOptions& options) {
  return std::make_shared<PaperNet>(options);
}

}  // namespace volalign
