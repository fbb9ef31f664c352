#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/nn/network.h"
#include "train/distributed/flat_module.h"
#include "train/optimizer_rule.h"
#include "train/train_config.h"

namespace volalign {

/// optim.optimizer on a FlatModule: Adam (Kingma and Ba 2015), AdamW (Loshchilov and Hutter 2019),
/// or a registered rule. Throws ConfigError for an unknown one.
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
  /// The memory of earlier steps, [N] each; of Adam, "mean" and "square" of the gradient. To be
  /// saved and restored together with the number of steps.
  const std::vector<std::pair<std::string, at::Tensor>>& moments() const { return moments_; }

 private:
  /// Clips by the factor `clip`, if defined, and steps `count` values from `begin` on.
  void StepPiece(std::int64_t begin, std::int64_t count, double lr, const at::Tensor& clip,
                 bool decay, const at::Tensor& finite);

  OptimConfig config_;
  OptimizerRule rule_;
  FlatModule* module_;
  std::vector<std::pair<std::string, at::Tensor>> moments_;
  std::int64_t steps_ = 0;
};

/// Learning rate of the step that starts after `samples` of `total` samples.
double LearningRate(const OptimConfig& config, std::int64_t samples, std::int64_t total);

/// The weights that are validated and shipped: an exponential running mean of the weights in
/// training. Its decay rises with the number of steps to the given one, so that it forgets the
/// random start early. With decay 0 they are the weights in training themselves.
class WeightAverage {
 public:
  /// `net` has the options of the network in training; `source` has that network's weights.
  WeightAverage(StructureNet net, double decay, FlatModule& source);

  /// To be called after each step; `steps` includes that one. If `finite`, a bool scalar on the
  /// device, is defined and false, nothing changes.
  void Update(FlatModule& source, std::int64_t steps, const at::Tensor& finite = {});
  /// With decay 0, copies the present weights, before net() is used. Else does nothing.
  void Refresh(FlatModule& source);
  /// Starts again from these weights.
  void Reset(FlatModule& source);

  StructureNet& net() { return net_; }
  const StructureNet& net() const { return net_; }

 private:
  StructureNet net_;
  FlatModule flat_;
  double decay_;
};

}  // namespace volalign
