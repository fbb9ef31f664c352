#pragma once

#include <ATen/core/Tensor.h>
#include <torch/nn/module.h>

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "train/train_config.h"

namespace volalign {

/// Moves a module's parameters, gradients and (float32) buffers into one flat tensor each, of which
/// they become views: clipping, optimiser and averaging are then a few operations on long vectors
/// instead of some hundred on short ones. The module must not be moved to another device
/// afterwards. Convolution weights come first.
class FlatModule {
 public:
  explicit FlatModule(torch::nn::Module& module);

  at::Tensor& parameters() { return parameters_; }           ///< [N]
  at::Tensor& gradients() { return gradients_; }             ///< [N], accumulated by backward()
  at::Tensor& buffers() { return buffers_; }                 ///< [M]
  std::int64_t num_weights() const { return num_weights_; }  ///< leading values that decay

  /// Views of a vector that is laid out as parameters(), under prefix + parameter name.
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

/// Learning rate of the step that starts after `samples` of `total` samples.
double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total);

/// Adam (Kingma and Ba 2015) or AdamW (Loshchilov and Hutter 2019) on a FlatModule.
class Adam {
 public:
  Adam(const OptimConfig& config, FlatModule* module);

  /// Norm of the gradient, before clipping: float32 scalar on the module's device.
  at::Tensor GradientNorm() const;
  /// Clips the gradient to clip_norm given its norm, takes a step and zeroes the gradient.
  void Step(double lr, const at::Tensor& gradient_norm);

  std::int64_t steps() const { return steps_; }
  /// First and second moments as [N] tensors, for saving and restoring together with the number of
  /// steps.
  at::Tensor& mean() { return mean_; }
  at::Tensor& square() { return square_; }
  void set_steps(std::int64_t steps) { steps_ = steps; }

 private:
  OptimConfig config_;
  FlatModule* module_;
  at::Tensor mean_, square_;
  std::int64_t steps_ = 0;
};

}  // namespace volalign
