// Training in other types and layouts and on other devices against the CPU in float32, on the same
// rendered batches. tests/gpu.sh shows the rows that it prints.

#include <ATen/TensorOperators.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <torch/cuda.h>

#include <cmath>
#include <vector>

#include "core/config/config.h"
#include "core/nn/cpu/torch_threads.h"
#include "train/compute.h"
#include "train/optimizer.h"
#include "train/step.h"
#include "train/train_state.h"
#include "train/training_data.h"

namespace volalign::device_test {
namespace {

/// What some steps gave, on the CPU in float64.
struct Trained {
  double loss = 0;  ///< of the first step
  at::Tensor gradient, start, weights;
};

at::Tensor OnCpu(const at::Tensor& t) { return t.detach().to(at::kCPU, at::kDouble, false, true); }

double Difference(const at::Tensor& a, const at::Tensor& b, const at::Tensor& whole) {
  return ((a - b).norm() / whole.norm()).item<double>();
}

class Device : public testing::Test {
 protected:
  Device() {
    SetTorchThreads(1);
    ConfigSource source = ConfigSource::FromFile("configs/m05-lite.yaml");
    // From random weights the soft Procrustes term would have a gradient that the last bits decide:
    // all keypoints are in one place.
    for (const char* setting :
         {"run.init=models/m05-lite.safetensors", "loss.lambda_warmup_samples=0",
          "data.renderer=cpu", "run.validation_samples=0", "run.batch_size=4",
          "data.image_sizes=[80x72]", "data.sensors=[azure_kinect_nfov_binned]"})
      source.Set(setting);
    config_ = ReadTrainConfig(source);
    data_ = OpenTrainingData(config_);
    const SampleSource samples = data_.open_training(0);
    for (int i = 0; i < 4; ++i) batches_.push_back(samples());
    reference_ = Train(Compute());
  }

  /// A step for each batch.
  Trained Train(const Compute& compute) const {
    TrainState state(config_, data_.structure.num_classes(), compute);
    StartFrom(config_.run.init, data_.structure, &state);
    const TrainingLoss loss(config_.loss, data_.structure, compute.device);
    BatchPacker packer(compute.device);
    Trained result;
    result.start = OnCpu(state.flat.parameters());
    std::int64_t samples = 0;
    for (const std::vector<Sample>& drawn : batches_) {
      const StepNumbers numbers = ComputeGradient(state, loss, Unpack(packer.Pack(drawn)), compute,
                                                  samples, config_.run.micro_batch);
      if (samples == 0) {
        result.loss = ReadSums(numbers.Sums(), loss.names()).loss;
        result.gradient = OnCpu(state.flat.gradients());
      }
      state.Update(LearningRate(config_.optim, samples, config_.run.samples), numbers.norm,
                   numbers.finite);
      samples += static_cast<std::int64_t>(drawn.size());
    }
    result.weights = OnCpu(state.flat.parameters());
    return result;
  }

  /// Relative differences; the weights' is over the way that they have gone.
  void ExpectParity(const Compute& compute, double most_of_loss, double most_of_gradient) {
    SCOPED_TRACE(ToString(compute));
    const Trained here = Train(compute);
    const double loss = std::abs(here.loss / reference_.loss - 1);
    const double gradient = Difference(here.gradient, reference_.gradient, reference_.gradient);
    const double weights =
        Difference(here.weights, reference_.weights, reference_.weights - reference_.start);
    fmt::print("| {} | {:.1e} | {:.1e} | {:.1e} |\n", ToString(compute), loss, gradient, weights);
    EXPECT_LT(loss, most_of_loss);
    EXPECT_LT(gradient, most_of_gradient);
    // Steps were taken, and in about the same direction.
    EXPECT_GT((here.weights - here.start).norm().item<double>(), 0);
    EXPECT_LT(weights, 0.5);
  }

  TrainConfig config_;
  TrainingData data_;
  std::vector<std::vector<Sample>> batches_;
  Trained reference_;
};

TEST_F(Device, CpuTrainsInBf16AndChannelsLast) {
  ExpectParity({at::kCPU, at::kFloat, true}, 1e-5, 1e-3);
  // Eight bits of mantissa: 0.111 channels-last; 0.309 where the processor has no instructions for
  // them, by LibTorch 1.13's own convolutions (docs/benchmarks.md).
  ExpectParity({at::kCPU, at::kBFloat16, false}, 0.01, 0.25);
  ExpectParity({at::kCPU, at::kBFloat16, true}, 0.01, ProcessorHasBf16() ? 0.25 : 0.6);
}

// TF32 convolutions have 10 bits of mantissa: on an H100 the first loss was off by 1e-5 and the
// norm of the gradient by 1 %.
TEST_F(Device, CudaTrainsAsTheCpu) {
  ASSERT_TRUE(torch::cuda::is_available());
  for (const bool channels_last : {false, true}) {
    ExpectParity({at::kCUDA, at::kFloat, channels_last}, 1e-3, 0.05);
    ExpectParity({at::kCUDA, at::kBFloat16, channels_last}, 0.01, 0.25);
  }
}

}  // namespace
}  // namespace volalign::device_test
