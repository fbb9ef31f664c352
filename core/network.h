#pragma once

#include <c10/core/ScalarType.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

namespace volalign {

enum class Normalization { kNone, kBatch, kGroup };
enum class InputEncoding { kDepth, kDepthMask };

/// "none", "batch", "group"; "depth", "depth_mask". Parsing throws ConfigError for other words.
const char* ToString(Normalization normalization);
const char* ToString(InputEncoding input);
Normalization ParseNormalization(const std::string& word);
InputEncoding ParseInputEncoding(const std::string& word);

/// Channels that EncodeDepth makes: 1 or 2.
int EncodedChannels(InputEncoding input);

/// depth_mask: depth is centred here, m, where the structure stands in training.
inline constexpr double kDepthCentre = 2.0;
/// depth_mask: anything farther, m, is background whatever its distance; clamping there keeps stray
/// far values (Azure Kinect reports up to 16 m) from dominating the batch statistics.
inline constexpr double kDepthClamp = 6.0;

/// Network input [B,C,H,W] float32 of depth maps [B,1,H,W] float32, m, 0 where there is none.
///   kDepth:     depth itself (the paper), C = 1
///   kDepthMask: (min(depth, kDepthClamp) - kDepthCentre) * mask and mask = depth > 0, C = 2
/// Throws Error for another shape or type.
at::Tensor EncodeDepth(const at::Tensor& depth, InputEncoding input);

/// The defaults are the network of the paper (section "Semantic Correspondences").
struct StructureNetOptions {
  int base_channels = 32;  ///< c >= 1
  int num_classes = 21;    ///< K >= 2, background included
  bool attention = true;
  Normalization normalization = Normalization::kNone;
  InputEncoding input = InputEncoding::kDepth;
  int residual_blocks = 4;     ///< >= 0
  double background_bias = 0;  ///< initial bias of the background class in the classifier

  /// Throws ConfigError that names option, value and constraint.
  void Validate() const;
  friend bool operator==(const StructureNetOptions& a, const StructureNetOptions& b);
};

/// Convolution ("same" padding, odd kernel, stride 1), then normalisation if there is one.
/// Parameters `weight` [out,in,k,k] and `bias` [out] (absent before a normalisation, which would
/// cancel it), and of a normalisation `norm_weight`, `norm_bias` [out], with kBatch also buffers
/// `running_mean`, `running_var` [out].
class ConvUnitImpl : public torch::nn::Module {
 public:
  ConvUnitImpl(int in, int out, int kernel, Normalization normalization);

  /// x [B,in,H,W] -> [B,out,H,W] in `dtype`.
  at::Tensor forward(const at::Tensor& x, at::ScalarType dtype);

  at::Tensor weight, bias, norm_weight, norm_bias, running_mean, running_var;

 private:
  Normalization normalization_;
};
TORCH_MODULE(ConvUnit);

/// The layers of the network.
struct StructureNetLayers {
  struct ResidualBlock {
    ConvUnit first{nullptr}, second{nullptr};
  };
  struct DecoderLevel {
    ConvUnit first{nullptr}, second{nullptr}, up{nullptr}, merge{nullptr};
  };
  std::vector<std::vector<ConvUnit>> encoder;  ///< a group between two pools each
  std::vector<ResidualBlock> bottleneck;
  ConvUnit attention{nullptr};        ///< empty without attention
  std::vector<DecoderLevel> decoder;  ///< lowest resolution first
  ConvUnit last{nullptr}, classifier{nullptr};
};

/// What the network makes of an encoded input.
struct NetworkOutput {
  at::Tensor log_probabilities;  ///< [B,K,H,W] float32
  /// The paper's mask M, [B,1,H/16,W/16] float32 from 0 to 1; undefined without attention.
  at::Tensor attention;
};

/// The paper's segmentation network (section "Semantic Correspondences"): encoder of 14
/// convolutions and 4 max-pools, pre-activated residual bottleneck, soft attention, decoder with
/// skips and 14 convolutions. Weights are initialised by Xavier's uniform rule, biases with 0.
class StructureNetImpl : public torch::nn::Module {
 public:
  /// Throws ConfigError for invalid options.
  explicit StructureNetImpl(const StructureNetOptions& options);

  /// Encoded input [B,C,H,W] float32 (EncodeDepth), any H, W >= 16 -> log-probabilities [B,K,H,W]
  /// float32. Throws Error for another shape.
  at::Tensor forward(const at::Tensor& input);

  /// forward, with the attention beside it. On a CPU this is the slower way to train.
  NetworkOutput ForwardWithAttention(const at::Tensor& input);

  /// Type in which all but the first convolution, the normalisation statistics and the log-softmax
  /// are computed: kFloat or kBFloat16. Weights stay float32. bfloat16 has 16 mm steps at 3 m, so
  /// the depth itself never gets there.
  void SetComputeType(at::ScalarType dtype);

  /// Memory layout of the activations in training. On a CPU, channels-last training has passes of
  /// its own (training_forward.h).
  void SetChannelsLast(bool channels_last) { channels_last_ = channels_last; }

  const StructureNetOptions& options() const { return options_; }
  void pretty_print(std::ostream& stream) const override;
  /// A line a layer: name, kernel, channels; then the number of parameters.
  std::string prettyString() const;

 private:
  void RequireInput(const at::Tensor& input) const;
  ConvUnit Add(const std::string& name, int in, int out, int kernel);
  at::Tensor Relu(ConvUnit& unit, const at::Tensor& x);

  StructureNetOptions options_;
  at::ScalarType dtype_ = at::kFloat;
  bool channels_last_ = false;
  StructureNetLayers layers_;
};
TORCH_MODULE(StructureNet);

/// Epsilon of both normalisations, and the number of groups of group normalisation over `channels`.
inline constexpr double kNormEpsilon = 1e-5;
std::int64_t NormGroups(std::int64_t channels);

/// Number of trainable values.
std::int64_t CountParameters(const torch::nn::Module& module);

}  // namespace volalign
