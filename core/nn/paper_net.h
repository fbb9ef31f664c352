#pragma once

#include <c10/core/ScalarType.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>

#include <vector>

#include "core/nn/network.h"

namespace volalign {

/// Convolution ("same" padding, odd kernel, stride 1), then normalisation if there is one.
/// Parameters: `weight` [out,in,k,k] and `bias` [out] (absent before a normalisation, which would
/// cancel it). A normalisation adds `norm_weight` and `norm_bias` [out], and with kBatch the
/// buffers `running_mean` and `running_var` [out].
class ConvUnitImpl : public torch::nn::Module {
 public:
  ConvUnitImpl(int in, int out, int kernel, Normalization normalization);

  /// x [B,in,H,W] -> [B,out,H,W] in `dtype`. In training on a CPU by Winograd's algorithm if that
  /// is faster (WinogradSuits).
  at::Tensor forward(const at::Tensor& x, at::ScalarType dtype);

  /// The same of x enlarged to the size of `like` by repetition.
  at::Tensor ForwardEnlarged(const at::Tensor& x, const at::Tensor& like, at::ScalarType dtype);

  at::Tensor weight, bias, norm_weight, norm_bias, running_mean, running_var;

 private:
  bool IsTrained() const;
  at::Tensor Normalize(const at::Tensor& y, at::ScalarType dtype);

  Normalization normalization_;
};
TORCH_MODULE(ConvUnit);

/// The mask [B,1,h,w] of x [B,C,h,w], in float32 for any type of x. The type bfloat16 has no number
/// between 0.996 and 1, and a mask that is rounded to 1 has no gradient.
at::Tensor AttentionMask(const ConvUnitImpl& unit, const at::Tensor& x);

/// The layers of the network.
struct PaperNetLayers {
  struct ResidualBlock {
    ConvUnit first{nullptr}, second{nullptr};
  };
  struct DecoderLevel {
    ConvUnit first{nullptr}, second{nullptr}, up{nullptr}, merge{nullptr};
  };
  std::vector<std::vector<ConvUnit>> encoder;  ///< groups, with a pool between two
  std::vector<ResidualBlock> bottleneck;
  ConvUnit attention{nullptr};        ///< empty without attention
  std::vector<DecoderLevel> decoder;  ///< lowest resolution first
  ConvUnit last{nullptr}, classifier{nullptr};
};

/// The paper's segmentation network (section "Semantic Correspondences"): encoder of 14
/// convolutions and 4 max-pools, pre-activated residual bottleneck, soft attention, and decoder
/// with skips and 14 convolutions. Weights are initialised by Xavier's uniform rule, biases with 0.
/// In bfloat16 the first convolution, the normalisation statistics, the mask and the log-softmax
/// stay float32.
class PaperNetImpl : public StructureNetImpl {
 public:
  /// Throws ConfigError for invalid options.
  explicit PaperNetImpl(const StructureNetOptions& options);

  NetworkOutput ForwardWithAttention(const at::Tensor& input) override;

 private:
  at::Tensor Relu(ConvUnit& unit, const at::Tensor& x);

  PaperNetLayers layers_;
};

}  // namespace volalign
