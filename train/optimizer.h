#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>

#include "train/flat_module.h"
#include "train/train_config.h"

namespace volalign {

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
