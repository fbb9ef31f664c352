// Training in other types and layouts and on other devices against the CPU in float32.

#include <gtest/gtest.h>
#include <torch/cuda.h>

#include <vector>

#include "core/nn/cpu/torch_threads.h"
#include "tests/train/train_on_device.h"
#include "train/compute.h"

namespace volalign::device_test {
namespace {

class Device : public testing::Test {
 protected:
  Device() {
    SetTorchThreads(1);
    config_ = ParityConfig({"run.batch_size=4", "data.image_sizes=[80x72]",
                            "data.sensors=[azure_kinect_nfov_binned]"});
    data_ = OpenTrainingData(config_);
    batches_ = DrawBatches(data_, 4);
    reference_ = TrainOnBatches(Compute(), config_, data_, batches_);
  }

  void ExpectParity(const Compute& compute, double loss, double gradient) {
    SCOPED_TRACE(ToString(compute));
    const Trained here = TrainOnBatches(compute, config_, data_, batches_);
    const Parity parity = Compare(here, reference_);
    EXPECT_LT(parity.loss, loss);
    EXPECT_LT(parity.gradient, gradient);
    // Steps were taken, and in about the same direction.
    EXPECT_GT((here.weights - here.start).norm().item<double>(), 0);
    EXPECT_LT(parity.weights, 0.5);
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
