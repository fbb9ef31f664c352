#pragma once

#include <c10/core/ScalarType.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/model/network_options.h"

namespace volalign {

/// Network input [B,C,H,W] float32 (EncodedChannels) from depth maps [B,1,H,W] float32, m, 0
/// without depth. Throws Error for another shape or type.
at::Tensor EncodeDepth(const at::Tensor& depth, InputEncoding input);

/// The output of a network for an encoded input.
struct NetworkOutput {
  at::Tensor log_probabilities;  ///< [B,K,H,W] float32
  /// The paper's mask M, [B,1,H/16,W/16] float32 from 0 to 1; undefined without attention.
  at::Tensor attention;
};

/// A network that segments the structure's sides: encoded depth in, log-probabilities out. The
/// paper's network is NewPaperNet's. A program may register others (RegisterNetwork).
class StructureNetImpl : public torch::nn::Module {
 public:
  /// Throws ConfigError for invalid options.
  explicit StructureNetImpl(const StructureNetOptions& options);

  /// Encoded input [B,C,H,W] float32 (EncodeDepth), any H, W >= 16. Throws Error for another shape.
  virtual NetworkOutput ForwardWithAttention(const at::Tensor& input) = 0;

  /// The log-probabilities alone, [B,K,H,W] float32; for training.
  virtual at::Tensor forward(const at::Tensor& input);

  /// Type in which most of the network is computed: kFloat or kBFloat16. Weights stay float32.
  /// bfloat16 has 16 mm steps at 3 m, so the depth itself stays in float32. Throws Error for
  /// another type.
  void SetComputeType(at::ScalarType dtype);

  /// Memory layout of the activations in training.
  void SetChannelsLast(bool channels_last) { channels_last_ = channels_last; }

  const StructureNetOptions& options() const { return options_; }

 protected:
  /// Throws Error if ForwardWithAttention cannot take `input`.
  void RequireInput(const at::Tensor& input) const;
  at::ScalarType compute_type() const { return dtype_; }
  bool channels_last() const { return channels_last_; }

 private:
  StructureNetOptions options_;
  at::ScalarType dtype_ = at::kFloat;
  bool channels_last_ = false;
};

/// The paper's network (core/model/paper_units.h). Weights are initialised by Xavier's uniform
/// rule, biases with 0. Throws ConfigError for invalid options.
std::shared_ptr<StructureNetImpl> NewPaperNet(const StructureNetOptions& options);

/// Makes a network with weights from LibTorch's default generator.
using NetworkFactory = std::function<std::shared_ptr<StructureNetImpl>(const StructureNetOptions&)>;

/// Makes `kind` a value of model.kind, for training and for loading checkpoints. To be called at
/// the start of a program, before other threads run. Throws Error if the kind exists.
void RegisterNetwork(const std::string& kind, NetworkFactory factory);

/// "paper", then the registered kinds.
std::vector<std::string> NetworkKinds();

/// A network of one of the kinds.
class StructureNet : public torch::nn::ModuleHolder<StructureNetImpl> {
 public:
  StructureNet(std::nullptr_t)
      : ModuleHolder(nullptr) {}  // NOLINT: an empty holder, as TORCH_MODULE has it
  /// Makes a network of options.kind. Throws ConfigError for invalid options or an unknown kind.
  explicit StructureNet(const StructureNetOptions& options);
};

}  // namespace volalign
