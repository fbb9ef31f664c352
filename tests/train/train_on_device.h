#pragma once

#include <ATen/TensorOperators.h>
#include <ATen/core/Tensor.h>

#include <cmath>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "train/compute.h"
#include "train/learner.h"
#include "train/optimizer.h"
#include "train/step.h"
#include "train/training_data.h"

namespace volalign {

/// What some steps gave, on the CPU in float64.
struct Trained {
  double loss = 0;  ///< of the first step
  at::Tensor gradient, start, weights;
};

/// How far training is from a reference's, relatively; the weights' difference over the way that
/// they have gone.
struct Parity {
  double loss, gradient, weights;
};

/// m05-lite's weights on samples of the tiles, with these settings (KEY=VALUE). From random weights
/// the soft Procrustes term would have a gradient that the last bits decide: all keypoints are in
/// one place.
inline TrainConfig ParityConfig(const std::vector<std::string>& settings) {
  ConfigSource source = ConfigSource::FromFile("configs/m05-lite.yaml");
  source.Set("data.renderer=cpu");
  source.Set("loss.lambda_warmup_samples=0");
  source.Set("run.validation_samples=0");
  source.Set("run.init=models/m05-lite.safetensors");
  for (const std::string& setting : settings) source.Set(setting);
  return ReadTrainConfig(source);
}

inline std::vector<std::vector<Sample>> DrawBatches(const TrainingData& data, int steps) {
  const SampleSource source = data.open_training(0);
  std::vector<std::vector<Sample>> batches;
  for (int i = 0; i < steps; ++i) batches.push_back(source());
  return batches;
}

/// A step for each batch.
inline Trained TrainOnBatches(const Compute& compute, const TrainConfig& config,
                              const TrainingData& data,
                              const std::vector<std::vector<Sample>>& batches) {
  Learner learner(config, data.structure.num_classes(), compute);
  StartFrom(config.run.init, data.structure, &learner);
  const TrainingLoss loss(config.loss, data.structure, compute.device);
  BatchPacker packer(compute.device);
  const auto on_cpu = [](const at::Tensor& t) {
    return t.detach().to(at::kCPU, at::kDouble, false, true);
  };
  Trained result;
  result.start = on_cpu(learner.flat.parameters());
  std::int64_t samples = 0;
  for (const std::vector<Sample>& drawn : batches) {
    const StepNumbers numbers = ComputeGradient(learner, loss, Unpack(packer.Pack(drawn)), compute,
                                                samples, config.run.micro_batch);
    if (samples == 0) {
      result.loss = ReadSums(numbers.Sums(), loss.names()).loss;
      result.gradient = on_cpu(learner.flat.gradients());
    }
    learner.Update(LearningRate(config.optim, samples, config.run.samples), numbers.norm,
                   numbers.finite);
    samples += static_cast<std::int64_t>(drawn.size());
  }
  result.weights = on_cpu(learner.flat.parameters());
  return result;
}

inline Parity Compare(const Trained& here, const Trained& reference) {
  const auto difference = [](const at::Tensor& a, const at::Tensor& b, const at::Tensor& whole) {
    return ((a - b).norm() / whole.norm()).item<double>();
  };
  return {std::abs(here.loss / reference.loss - 1),
          difference(here.gradient, reference.gradient, reference.gradient),
          difference(here.weights, reference.weights, reference.weights - reference.start)};
}

}  // namespace volalign
