// Trains on samples of a sensor that volalign has no noise model of: `own_noise recipe.yaml
// RUN_FOLDER`.
#include <cstddef>
#include <cstdio>
#include <exception>

#include "core/base/input_file.h"
#include "render/noise.h"
#include "train/trainer.h"

namespace {

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
  if (argc != 3) {
    std::fprintf(stderr, "usage: own_noise recipe.yaml RUN_FOLDER\n");
    return 1;
  }
  try {
    volalign::RegisterNoiseModel("quadratic", QuadraticNoise);
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
