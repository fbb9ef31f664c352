#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "train/batch.h"
#include "train/compute.h"
#include "train/distributed/process_group.h"
#include "train/learner.h"
#include "train/log/metrics.h"
#include "train/losses.h"

namespace volalign {

/// What a step computed, on its device.
struct StepNumbers {
  /// [3 + N] float64: loss, degenerate samples, the N terms of the loss, norm of the gradient.
  at::Tensor values;
  at::Tensor norm;    ///< float32 scalar: that of the gradient, before clipping
  at::Tensor finite;  ///< bool scalar: loss and norm are

  /// [5 + N] float64 that add up over steps: `values`, or 0 where the step is not finite, 1, and
  /// whether the step is to be skipped.
  at::Tensor Sums() const;
};

/// Of sums of StepNumbers::Sums, but for the times. `names`: TrainingLoss::names(). Waits for the
/// device.
StepReport ReadSums(const at::Tensor& sums, const std::vector<std::string>& names);

/// Forward, loss and backward pass of one batch after `samples` samples, `micro_batch` samples at a
/// time (0: all): fills `learner.flat`'s gradient. Changes no weight, so that a step that is not
/// finite can be skipped; running statistics of a batch normalisation move. `times`, but for data
/// and optim, are measured where it is not null: that waits for the device after each part.
/// `between` is called between micro-batches; what it throws is passed on.
/// Where `batch` is a process's slice of one, `share` is its share of the samples, and `group` adds
/// up gradients and report over the processes.
StepNumbers ComputeGradient(Learner& learner, const TrainingLoss& loss, const Batch& batch,
                            const Compute& compute, std::int64_t samples, int micro_batch,
                            StepTimes* times = nullptr, double share = 1,
                            ProcessGroup* group = nullptr,
                            const std::function<void()>& between = {});

}  // namespace volalign
