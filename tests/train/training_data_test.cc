#include "train/training_data.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "core/nn/cpu/torch_threads.h"
#include "render/sample.h"

namespace volalign::training_data_test {
namespace {

/// Rendered, two samples of 40 x 36 pixels a batch.
TrainConfig SmallRecipe() {
  SetTorchThreads(1);
  ConfigSource source = ConfigSource::FromFile("configs/m05-lite.yaml");
  for (const char* assignment :
       {"data.image_sizes=[40x36, 64x36]", "run.batch_size=2", "run.samples=24",
        "run.validation_samples=4", "optim.warmup_samples=4"}) {
    source.Set(assignment);
  }
  return ReadTrainConfig(source);
}

void ExpectSame(const std::vector<Sample>& a, const std::vector<Sample>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].index, b[i].index);
    EXPECT_EQ(a[i].depth, b[i].depth);
    EXPECT_EQ(a[i].labels, b[i].labels);
  }
}

TEST(OpenTrainingData, SamplesDependOnSeedAndNumberAlone) {
  TrainConfig config = SmallRecipe();
  const TrainingData data = OpenTrainingData(config);
  EXPECT_EQ(data.structure.Hash(), ReadStructure("configs/structure.yaml").Hash());
  EXPECT_EQ(data.identity, "");
  const auto from_start = data.open_training(0);
  const std::vector<Sample> first = from_start->Next(), second = from_start->Next();
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].index, 0u);
  EXPECT_EQ(second[0].index, 2u);
  EXPECT_FALSE(first[0].depth == second[0].depth);
  ExpectSame(data.open_training(2)->Next(), second);
  // Of another process: its slice of each batch.
  ExpectSame(OpenTrainingData(config, {1, 1}).open_training(2)->Next(), {second[1]});

  const std::vector<Sample> held_out = data.open_validation()->Next();
  ExpectSame(data.open_validation()->Next(), held_out);
  EXPECT_FALSE(held_out[0].depth == first[0].depth);
  config.run.validation_seed = 5;
  config.run.seed = 6;
  const TrainingData other = OpenTrainingData(config);
  EXPECT_FALSE(other.open_validation()->Next()[0].depth == held_out[0].depth);
  EXPECT_FALSE(other.open_training(0)->Next()[0].depth == first[0].depth);
}

}  // namespace
}  // namespace volalign::training_data_test
