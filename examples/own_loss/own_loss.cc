// Trains with a loss and a network that volalign does not have: `own_loss recipe.yaml RUN_FOLDER`.
#include <ATen/TensorOperators.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/one_hot.h>
#include <torch/nn/modules/conv.h>

#include <cstdio>
#include <exception>
#include <memory>
#include <string>

#include "core/base/input_file.h"
#include "core/nn/network.h"
#include "train/loss_term.h"
#include "train/trainer.h"

namespace {

/// The soft Dice loss of Milletari et al., "V-Net" (3DV 2016): 1 - 2 |P T| / (|P| + |T|), the mean
/// over the sides.
class DiceTerm : public volalign::LossTerm {
 public:
  explicit DiceTerm(int num_classes) : num_classes_(num_classes) {}

  at::Tensor operator()(const volalign::LossInput& input) const override {
    const at::Tensor truth = at::one_hot(input.labels, num_classes_).permute({0, 3, 1, 2});
    const at::Tensor found = input.log_probs.exp();  // [B,K,H,W]
    const at::Tensor both = (found * truth).sum({2, 3}).narrow(1, 1, num_classes_ - 1);
    const at::Tensor each = (found + truth).sum({2, 3}).narrow(1, 1, num_classes_ - 1);
    return 1 - (2 * both / each.clamp_min(1e-6)).mean();
  }

 private:
  int num_classes_;
};

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

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: own_loss recipe.yaml RUN_FOLDER\n");
    return 1;
  }
  try {
    volalign::RegisterLossTerm("dice", [](const volalign::Structure& structure, const at::Device&) {
      return std::make_unique<DiceTerm>(structure.num_classes());
    });
    volalign::RegisterNetwork("dilated", [](const volalign::StructureNetOptions& options) {
      return std::make_shared<DilatedNet>(options);
    });
    if (volalign::DataFolder().empty()) volalign::SetDataFolder(VOLALIGN_DATA);
    volalign::TrainOptions options;
    options.run_dir = argv[2];
    volalign::Train(volalign::ReadTrainConfig(volalign::ConfigSource::FromFile(argv[1])), options);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
