// How far training on a device is from training on the CPU in float32: loss and gradient of the
// first step, and weights after 20, on the same rendered batches. Serves tests/gpu.sh.
//   device_parity DEVICE [KEY=VALUE of configs/m05-lite.yaml ...]

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <vector>

#include "core/nn/cpu/torch_threads.h"
#include "core/nn/torch_device.h"
#include "tests/bench/program.h"
#include "tests/train/train_on_device.h"

namespace volalign {
namespace {

constexpr int kSteps = 20;

int Main(int argc, char** argv) {
  const std::string device_name = argc > 1 ? argv[1] : "cpu";
  const TrainConfig config =
      ParityConfig(std::vector<std::string>(argv + std::min(argc, 2), argv + argc));
  SetTorchThreads(config.run.threads);
  const at::Device device = ParseDevice("device", device_name);
  const TrainingData data = OpenTrainingData(config);
  const std::vector<std::vector<Sample>> batches = DrawBatches(data, kSteps);
  const Trained reference = TrainOnBatches(Compute(), config, data, batches);
  fmt::print(
      "| device | precision | layout | loss of step 1 | gradient of step 1 | weights after {} "
      "steps |\n|---|---|---|---|---|---|\n",
      kSteps);
  for (const at::ScalarType type : {at::kFloat, at::kBFloat16}) {
    for (const bool channels_last : {false, true}) {
      const Parity parity =
          Compare(TrainOnBatches({device, type, channels_last}, config, data, batches), reference);
      fmt::print("| {} | {} | {} | {:.1e} | {:.1e} | {:.1e} |\n", device.str(),
                 type == at::kFloat ? "fp32" : "bf16",
                 channels_last ? "channels-last" : "contiguous", parity.loss, parity.gradient,
                 parity.weights);
      std::fflush(stdout);
    }
  }
  return 0;
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  return volalign::StatusOf([&] { return volalign::Main(argc, argv); });
}
