#pragma once

#include <ATen/core/Tensor.h>
#include <torch/nn/module.h>

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace volalign {

/// Moves a module's parameters, gradients and (float32) buffers into one flat tensor each. They
/// become views of it. Clipping, optimiser and averaging then take a few operations on long vectors
/// instead of some hundred on short ones. The module must not be moved to another device
/// afterwards. Convolution weights come first. Each parameter and buffer begins at a multiple of
/// kSlotBytes, aligned for vector instructions and for cuDNN, which needs 16 bytes. The gaps are 0
/// and stay so.
class FlatModule {
 public:
  static constexpr std::int64_t kSlotBytes = 64;  ///< a cache line, and a vector of AVX-512

  explicit FlatModule(torch::nn::Module& module);

  at::Tensor& parameters() { return parameters_; }           ///< [N]
  at::Tensor& gradients() { return gradients_; }             ///< [N], accumulated by backward()
  at::Tensor& buffers() { return buffers_; }                 ///< [M]
  std::int64_t num_weights() const { return num_weights_; }  ///< leading values that decay

  /// Adds views of a vector with the layout of parameters(), under prefix + parameter name.
  void AddViews(const at::Tensor& flat, const std::string& prefix,
                std::map<std::string, at::Tensor>* tensors) const;

 private:
  struct Slot {
    std::string name;
    std::int64_t offset;
    std::vector<std::int64_t> sizes;
  };
  at::Tensor parameters_, gradients_, buffers_;
  std::vector<Slot> slots_;
  std::int64_t num_weights_ = 0;
};

}  // namespace volalign
