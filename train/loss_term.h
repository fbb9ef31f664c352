#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// The input of a term of the loss.
struct LossInput {
  const at::Tensor& log_probs;  ///< [B,K,H,W] float32, differentiable
  const at::Tensor& depth;      ///< [B,1,H,W] float32, m, 0 without depth
  const at::Tensor& labels;     ///< [B,H,W] int64, 0 for the background
  const at::Tensor& rays;       ///< [B,2,H,W] float32, x / z and y / z of each pixel
};

/// A term that a program adds to the loss.
class LossTerm {
 public:
  virtual ~LossTerm() = default;
  /// Mean over the batch's samples: a differentiable scalar on the device of `input`.
  virtual at::Tensor operator()(const LossInput& input) const = 0;
};

using LossTermFactory =
    std::function<std::unique_ptr<LossTerm>(const Structure& structure, const at::Device& device)>;

/// Makes `name` a value of loss.terms, with the name loss_NAME in logs. To be called at the start
/// of a program, before other threads run. Throws Error if the term exists.
void RegisterLossTerm(const std::string& name, LossTermFactory factory);

/// Throws ConfigError for a name that is not registered.
std::unique_ptr<LossTerm> MakeLossTerm(const std::string& name, const Structure& structure,
                                       const at::Device& device);

}  // namespace volalign
