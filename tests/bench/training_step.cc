// A training step on one batch of made-up depth maps: serves training_step.py. For each line of
// standard input it takes one step and prints its times, s: `forward loss backward optimiser`.
// Options are KEY=VALUE of the recipe; the default one is m05-lite's network and optimiser.

#include <ATen/ATen.h>
#include <fmt/format.h>

#include <chrono>
#include <iostream>
#include <string>

#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "core/geometry/structure.h"
#include "core/nn/cpu/torch_threads.h"
#include "tests/bench/program.h"
#include "train/compute.h"
#include "train/learner.h"
#include "train/step.h"
#include "train/train_config.h"

namespace volalign {
namespace {

Batch MakeBatch(std::int64_t samples, ImageSize size, int classes) {
  Intrinsics camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = 0.8 * size.width;
  camera.cx = 0.5 * size.width;
  camera.cy = 0.5 * size.height;
  const RayTable rays = ComputeRays(camera);
  at::manual_seed(1);
  Batch batch;
  batch.depth = 1.5 + at::rand({samples, 1, size.height, size.width});
  batch.depth *= at::rand(batch.depth.sizes()) > 0.1;
  batch.labels = at::randint(0, classes, {samples, size.height, size.width}, at::kLong);
  batch.rays = at::empty({samples, 2, size.height, size.width});
  auto out = batch.rays.accessor<float, 4>();
  for (std::int64_t s = 0; s < samples; ++s) {
    for (int v = 0; v < size.height; ++v) {
      for (int u = 0; u < size.width; ++u) {
        const auto& ray = rays.rays[static_cast<std::size_t>(v * size.width + u)];
        out[s][0][v][u] = ray.x();
        out[s][1][v][u] = ray.y();
      }
    }
  }
  return batch;
}

int Main(int argc, char** argv) {
  ConfigSource source = ConfigSource::FromFile("configs/m05-lite.yaml");
  std::string size = "320x180";
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.rfind("size=", 0) == 0) {
      size = argument.substr(5);
    } else {
      source.Set(argument);
    }
  }
  const TrainConfig config = ReadTrainConfig(source);
  SetTorchThreads(config.run.threads);
  KeepFreedMemory();
  const Structure structure = ReadStructure("configs/structure.yaml");
  const Compute compute = ChooseCompute(config.run);
  Learner learner(config, structure.num_classes(), compute);
  const TrainingLoss loss(config.loss, structure, compute.device);
  const Batch batch =
      MakeBatch(config.run.batch_size, ParseImageSize(size), structure.num_classes());
  std::cout << ToString(compute) << std::endl;
  std::int64_t samples = 1;
  for (std::string line; std::getline(std::cin, line);) {
    StepTimes times;
    const StepNumbers numbers =
        ComputeGradient(learner, loss, batch, compute, samples++, config.run.micro_batch, &times);
    const auto start = std::chrono::steady_clock::now();
    learner.Update(1e-4, numbers.norm, numbers.finite);
    Synchronize(compute.device);
    times.optim = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::cout << fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {}", times.forward, times.loss,
                             times.backward, times.optim,
                             ReadSums(numbers.Sums(), loss.names()).loss)
              << std::endl;
  }
  return 0;
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  return volalign::StatusOf([&] { return volalign::Main(argc, argv); });
}
