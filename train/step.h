#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <functional>

#include "train/batch.h"
#include "train/compute.h"
#include "train/distributed/gradient_reducer.h"
#include "train/learner.h"
#include "train/log/metrics.h"
#include "train/losses.h"

namespace volalign {

/// Forward, loss and backward pass of one batch after `samples` samples, `micro_batch` samples at a
/// time (0: all): fills `learner.flat`'s
/// gradient and the report, but for times.data and times.optim, and returns the gradient's norm as
/// a scalar on the device. Changes no weight, so that a caller can refuse a loss or norm that is
/// not finite; running statistics of a batch normalisation move.
/// `between` is called between micro-batches; what it throws is passed on.
/// Where `batch` is a process's slice of one, `share` is its share of the loss, and `reducer` adds
/// up gradients and report over the processes.
at::Tensor ComputeGradient(Learner& learner, const TrainingLoss& loss, const Batch& batch,
                           const Compute& compute, std::int64_t samples, int micro_batch,
                           StepReport* report, const LossShare& share = LossShare(),
                           GradientReducer* reducer = nullptr,
                           const std::function<void()>& between = {});

}  // namespace volalign
