#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <string>

#include "core/geometry/structure.h"

namespace volalign {

/// The input of the loss.
struct LossInput {
  const at::Tensor& log_probs;  ///< [B,K,H,W] float32, differentiable
  const at::Tensor& depth;      ///< [B,1,H,W] float32, m, 0 without depth
  const at::Tensor& labels;     ///< [B,H,W] int64, 0 for the background
  const at::Tensor& rays;       ///< [B,2,H,W] float32, x / z and y / z of each pixel
};

/// A term that a program adds to the loss. Mean over the batch's samples: a differentiable scalar
/// on the device of the input.
using LossTerm = std::function<at::Tensor(const LossInput&)>;

/// Makes the term of a run, which trains on `device`.
using LossTermFactory =
    std::function<LossTerm(const Structure& structure, const at::Device& device)>;

/// Makes `name` a value of loss.terms, with the name loss_NAME in logs. To be called at the start
/// of a program, before other threads run. Throws Error if the term exists.
void RegisterLossTerm(const std::string& name, LossTermFactory factory);

}  // namespace volalign
