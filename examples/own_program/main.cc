// The whole program volalign with a loss, a network, an optimiser, a metric and a noise model of
// its own: `own_program train --config recipe.yaml -o run`, then `own_program calibrate --model
// run/model.safetensors ...`.
#include <ATen/TensorOperators.h>
#include <ATen/ops/lerp.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/one_hot.h>
#include <torch/nn/modules/conv.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cli/main.h"
#include "core/base/input_file.h"
#include "core/nn/network.h"
#include "render/noise.h"
#include "train/loss_term.h"
#include "train/metric.h"
#include "train/optimizer_rule.h"

namespace {

/// The soft Dice loss of Milletari et al., "V-Net" (3DV 2016): 1 - 2 |P T| / (|P| + |T|), the mean
/// over the sides.
at::Tensor DiceLoss(const volalign::LossInput& input) {
  const std::int64_t classes = input.log_probs.size(1);
  const at::Tensor truth = at::one_hot(input.labels, classes).permute({0, 3, 1, 2});
  const at::Tensor found = input.log_probs.exp();  // [B,K,H,W]
  const at::Tensor both = (found * truth).sum({2, 3}).narrow(1, 1, classes - 1);
  const at::Tensor each = (found + truth).sum({2, 3}).narrow(1, 1, classes - 1);
  return 1 - (2 * both / each.clamp_min(1e-6)).mean();
}

/// Four dilated convolutions of one width.
class DilatedNet : public volalign::StructureNetImpl {
 public:
  explicit DilatedNet(const volalign::StructureNetOptions& options) : StructureNetImpl(options) {
    int channels = volalign::EncodedChannels(options.input);
    for (int i = 0; i < 4; ++i) {
      const int dilation = 1 << i;
      layers_.push_back(register_module(
          "layer" + std::to_string(i + 1),
          torch::nn::Conv2d(torch::nn::Conv2dOptions(channels, options.base_channels, 3)
                                .dilation(dilation)
                                .padding(dilation))));
      channels = options.base_channels;
    }
    classifier_ = register_module("classifier", torch::nn::Conv2d(torch::nn::Conv2dOptions(
                                                    channels, options.num_classes, 1)));
  }

  volalign::NetworkOutput ForwardWithAttention(const at::Tensor& input) override {
    RequireInput(input);
    at::Tensor x = input;
    for (torch::nn::Conv2d& layer : layers_) x = layer->forward(x).relu_();
    return {at::log_softmax(classifier_->forward(x), 1), at::Tensor()};
  }

 private:
  std::vector<torch::nn::Conv2d> layers_;
  torch::nn::Conv2d classifier_{nullptr};
};

/// Lion of Chen et al., "Symbolic Discovery of Optimization Algorithms" (NeurIPS 2023).
void StepLion(volalign::OptimizerStep& step) {
  at::Tensor& mean = step.moments[0];
  const at::Tensor update = at::lerp(step.gradient, mean, step.beta1).sign_();
  step.weights.mul_(1 - step.lr * step.weight_decay).sub_(update, step.lr);
  mean.lerp_(step.gradient, 1 - step.beta2);
}

/// Share of the pixels with depth whose label is right.
double Accuracy(const volalign::MetricInput& input) {
  double right = 0, measured = 0;
  for (std::size_t i = 0; i < input.depth.size(); ++i) {
    measured += input.depth[i] > 0;
    right += input.depth[i] > 0 && input.predicted[i] == input.labels[i];
  }
  return right / measured;
}

/// A sensor whose depth errors grow with the square of the distance and that loses one pixel in
/// twenty.
volalign::NoisyView QuadraticNoise(const volalign::NoiseInput& input,
                                   volalign::RandomStream& random) {
  constexpr double kSigmaAtOneMetre = 0.002;  // m
  constexpr double kLost = 0.05;
  volalign::NoisyView seen{input.view.depth, input.view.labels};
  for (std::size_t i = 0; i < seen.depth.size(); ++i) {
    const double z = seen.depth[i];
    const double error = random.Normal(0, kSigmaAtOneMetre * z * z);
    const bool lost = random.Chance(kLost) || z <= 0;
    seen.depth[i] = lost ? 0.0F : static_cast<float>(z + error);
    if (lost) seen.labels[i] = 0;
  }
  return seen;
}

}  // namespace

int main(int argc, char** argv) {
  volalign::RegisterLossTerm(
      "dice", [](const volalign::Structure&, const at::Device&) { return DiceLoss; });
  volalign::RegisterNetwork("dilated", [](const volalign::StructureNetOptions& options) {
    return std::make_shared<DilatedNet>(options);
  });
  volalign::RegisterNoiseModel("quadratic", QuadraticNoise);
  volalign::RegisterOptimizer("lion", {"mean"}, StepLion);
  volalign::RegisterMetric("accuracy", Accuracy);
  if (volalign::DataFolder().empty()) volalign::SetDataFolder(VOLALIGN_DATA);
  return volalign::Main(argc, argv);
}
