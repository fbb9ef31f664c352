#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "train/distributed/flat_module.h"
#include "train/train_config.h"

namespace volalign {

/// Adam (Kingma and Ba 2015) or AdamW (Loshchilov and Hutter 2019) on a FlatModule.
class Optimizer {
 public:
  Optimizer(const OptimConfig& config, FlatModule* module);

  /// Norm of the gradient before clipping: float32 scalar on the module's device.
  at::Tensor GradientNorm() const;
  /// Clips the gradient to clip_norm given its norm, takes a step and zeroes the gradient. If
  /// `finite`, a bool scalar on the device, is defined and false, weights and moments do not
  /// change. The host does not read `finite`.
  void Step(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite = {});

  std::int64_t steps() const { return steps_; }
  void set_steps(std::int64_t steps) { steps_ = steps; }
  /// The memory of earlier steps, [N] each: "mean" and "square" of the gradient. To be saved and
  /// restored together with the number of steps.
  const std::vector<std::pair<std::string, at::Tensor>>& moments() const { return moments_; }

 private:
  /// Clips by the factor `clip`, if defined, and steps `count` values from `begin` on.
  void StepPiece(std::int64_t begin, std::int64_t count, double lr, const at::Tensor& clip,
                 bool decay, const at::Tensor& finite);

  OptimConfig config_;
  FlatModule* module_;
  std::vector<std::pair<std::string, at::Tensor>> moments_;
  std::int64_t steps_ = 0;
};

}  // namespace volalign
