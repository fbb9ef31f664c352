#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace volalign {

/// A step on some of the weights. All tensors are [n] float32 on one device.
struct OptimizerStep {
  double lr = 0, beta1 = 0, beta2 = 0;  ///< optim.beta1, optim.beta2
  double weight_decay = 0;              ///< 0 for biases and normalisations
  std::int64_t number = 1;              ///< of the steps, this one included
  at::Tensor weights;                   ///< to be changed in place
  at::Tensor gradient;                  ///< clipped; may be changed
  std::vector<at::Tensor> moments;      ///< in the order of their names; to be changed in place
};

/// Runs on several threads at a time, each with other weights.
using OptimizerRule = std::function<void(OptimizerStep& step)>;

/// Makes `name` a value of optim.optimizer. `moments` names what the rule keeps from step to step
/// for each weight; each begins at 0 and is part of a run's state. To be called at the start of a
/// program, before other threads run. Throws Error if the name exists.
void RegisterOptimizer(const std::string& name, std::vector<std::string> moments,
                       OptimizerRule rule);

/// "adam", "adamw" and the registered ones.
std::vector<std::string> OptimizerNames();

}  // namespace volalign
