#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "train/batch.h"
#include "train/compute.h"
#include "train/distributed/process_group.h"
#include "train/log/metrics.h"
#include "train/losses.h"
#include "train/train_state.h"

namespace volalign {

/// The results of a step, on its device.
struct StepNumbers {
  /// [3 + N] float64: loss, degenerate samples, the N terms of the loss, norm of the gradient.
  at::Tensor values;
  at::Tensor norm;    ///< float32 scalar: norm of the gradient before clipping
  at::Tensor finite;  ///< bool scalar: loss and norm are finite

  /// [5 + N] float64 that add up over steps: `values` (0 if the step is not finite), 1, and 1 if
  /// the step is to be skipped, else 0.
  at::Tensor Sums() const;
};

/// The report from sums of StepNumbers::Sums, without times. `names`: TrainingLoss::names(). Waits
/// for the device.
StepReport ReadSums(const at::Tensor& sums, const std::vector<std::string>& names);

/// Forward, loss and backward pass of one batch after `samples` samples, `micro_batch` samples at a
/// time (0: all). Fills `state.flat`'s gradient. Changes no weight, so that a step that is not
/// finite can be skipped. Running statistics of a batch normalisation change. If `times` is not
/// null, all except data and optim are measured: this waits for the device after each part.
/// `between` is called between micro-batches; its exceptions are passed on. If `batch` is a
/// process's slice, `share` is its share of the samples, and `group` adds up gradients and report
/// over the processes.
StepNumbers ComputeGradient(TrainState& state, const TrainingLoss& loss, const Batch& batch,
                            const Compute& compute, std::int64_t samples, int micro_batch,
                            StepTimes* times = nullptr, double share = 1,
                            ProcessGroup* group = nullptr,
                            const std::function<void()>& between = {});

}  // namespace volalign
