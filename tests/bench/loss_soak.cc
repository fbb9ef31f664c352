// loss_soak BATCHES [SAMPLES A BATCH]: are the training loss and its gradient finite for so many
// random and hard batches?

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <fmt/format.h>

#include <cstdlib>

#include "tests/train/hard_batches.h"

int main(int argc, char** argv) {
  using namespace volalign;
  const long batches = argc > 1 ? std::atol(argv[1]) : 1000000;
  const long samples = argc > 2 ? std::atol(argv[2]) : 4;
  at::set_num_threads(1);
  at::manual_seed(1);
  const Structure structure = ReadStructure("configs/structure.yaml");
  const TrainingLoss loss(LossConfig(), structure, at::kCPU);
  long failed = 0;
  for (long i = 1; i <= batches; ++i) {
    const HardBatch hard = DrawHardBatch(samples, structure.num_classes());
    if (!FiniteLoss(loss, hard)) ++failed;
    if (i % 10000 == 0 || i == batches)
      fmt::print("{} batches of {} samples, {} not finite\n", i, samples, failed);
  }
  return failed == 0 ? 0 : 1;
}
