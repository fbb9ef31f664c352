#pragma once

#include <string>

#include "core/geometry/structure.h"
#include "core/nn/network.h"
#include "train/averaging.h"
#include "train/compute.h"
#include "train/distributed/flat_module.h"
#include "train/optimizer.h"
#include "train/train_config.h"

namespace volalign {

/// What a step changes and a state holds: the network in training, its optimiser and the average of
/// its weights.
class Learner {
 public:
  /// A new network for the structure's classes, drawn with config.run.seed.
  Learner(const TrainConfig& config, int num_classes, const Compute& compute);
  Learner(const Learner&) = delete;
  Learner& operator=(const Learner&) = delete;

  /// Clips, steps the optimiser and the average; the gradient is zero afterwards.
  void Update(double lr, const at::Tensor& gradient_norm);

  StructureNet net;
  FlatModule flat;  ///< the parameters of `net`
  Optimizer optimizer;
  WeightAverage average;
};

/// Takes over the weights of the checkpoint `path` (run.init) and returns the number of samples
/// that it was trained on. Throws ConfigError when its network is another one, DataError when its
/// labels are.
std::int64_t StartFrom(const std::string& path, const Structure& structure, Learner* learner);

}  // namespace volalign
