// Training on a folder against training on the rendered stream that the folder was written from.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "render/dataset.h"
#include "render/egl/renderers.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/synthetic_source.h"
#include "train/trainer.h"
#include "train/training_data.h"

namespace volalign::dataset_test {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

std::shared_ptr<const SampleContext> Context(const TrainConfig& recipe) {
  return std::make_shared<const SampleContext>(
      MakeSampleContext(recipe.data, recipe.run.batch_size));
}

void Write(const fs::path& dir, const TrainConfig& recipe, std::int64_t seed, std::uint64_t count,
           std::uint64_t first_index = 0) {
  DatasetOptions options;
  options.seed = static_cast<std::uint64_t>(seed);
  options.first_index = first_index;
  options.count = count;
  options.samples_per_folder = 10;
  options.make_renderer = ChooseRenderers(recipe.data.renderer).make;
  WriteDataset(dir, Context(recipe), options);
}

TEST(TrainOnADataset, GivesTheLossesOfTheRenderedStream) {
  const TempFolder folder;
  TrainConfig config = SmallRecipe();
  Train(config, QuietRun(folder / "rendered"));
  Write(folder / "train", config, config.run.seed, 24);
  Write(folder / "valid", config, config.run.validation_seed, 6);
  config.run.dataset = folder / "train";
  config.run.loader_threads = 3;
  Train(config, QuietRun(folder / "read"));
  const std::vector<json> rendered = MetricsRows(folder / "rendered");
  ASSERT_EQ(rendered.size(), 13u);  // 12 steps, 1 validation
  EXPECT_EQ(rendered, MetricsRows(folder / "read"));
  config.run.validation_dataset = folder / "valid";
  Train(config, QuietRun(folder / "both"));
  EXPECT_EQ(rendered, MetricsRows(folder / "both"));
}

TEST(TrainOnADataset, ResumesInALaterEpoch) {
  const TempFolder folder;
  TrainConfig config = SmallRecipe();
  Write(folder / "train", config, 7, 10);  // five batches: 24 samples are more than two epochs
  config.run.dataset = folder / "train";
  config.run.validation_samples = 0;
  Train(config, QuietRun(folder / "whole"));
  EXPECT_FALSE(Train(config, QuietRun(folder / "parts", 14)).finished);
  fs::rename(folder / "train", folder / "moved");
  config.run.dataset = folder / "moved";
  config.run.loader_threads = 2;
  EXPECT_TRUE(Train(config, QuietRun(folder / "parts", 0, true)).finished);
  EXPECT_EQ(MetricsRows(folder / "whole"), MetricsRows(folder / "parts"));

  Train(config, QuietRun(folder / "third", 6));
  const TrainOptions options = QuietRun(folder / "third", 6, true);
  config.run.dataset.clear();
  ExpectError<ConfigError>([&] { Train(config, options); }, {"other samples", "run.dataset = ''"});
  Write(folder / "other", config, 8, 10);
  config.run.dataset = folder / "other";
  ExpectError<ConfigError>([&] { Train(config, options); },
                           {"000000000006.state", "other samples", config.run.dataset});
}

class DatasetSamplesTest : public testing::Test {
 protected:
  SampleSource Open(std::uint64_t first_sample, int num_threads, std::uint64_t seed = 5) {
    return DatasetSamples(dataset_, {seed, first_sample, 2, num_threads, {}, 3});
  }

  static std::vector<std::uint64_t> Indices(const SampleSource& source, int batches) {
    std::vector<std::uint64_t> indices;
    for (int i = 0; i < batches; ++i) {
      for (const Sample& s : source()) indices.push_back(s.index);
    }
    return indices;
  }

  // Whole batches of two: 4, 5 to 24, 25; samples 3 and 26 stand alone.
  void SetUp() override {
    Write(folder_.path(), SmallRecipe(), 1, 24, 3);
    dataset_ = std::make_shared<const Dataset>(folder_.path());
  }

  const TempFolder folder_;
  std::shared_ptr<const Dataset> dataset_;
};

TEST_F(DatasetSamplesTest, EpochsAreShuffledBatchesOfEverySample) {
  EXPECT_EQ(CountBatches(*dataset_, 2), 11u);
  const std::vector<std::uint64_t> seen = Indices(Open(0, 3), 33);
  std::set<std::vector<std::uint64_t>> orders;
  for (std::size_t epoch = 0; epoch < 3; ++epoch) {
    const std::vector<std::uint64_t> order(seen.begin() + 22 * epoch,
                                           seen.begin() + 22 * (epoch + 1));
    for (std::size_t i = 0; i < 22; i += 2) {
      EXPECT_EQ(order[i] % 2, 0u);
      EXPECT_EQ(order[i + 1], order[i] + 1);
    }
    std::vector<std::uint64_t> sorted = order;
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t i = 0; i < 22; ++i) EXPECT_EQ(sorted[i], 4 + i);
    if (epoch == 0) {
      EXPECT_EQ(order, sorted);
    }
    orders.insert(order);
  }
  EXPECT_EQ(orders.size(), 3u);
  EXPECT_NE(seen, Indices(Open(0, 1, /*seed=*/6), 33));
  for (const std::uint64_t start : {0u, 8u, 22u, 24u, 60u}) {
    const std::vector<std::uint64_t> rest(seen.begin() + static_cast<long>(start), seen.end());
    EXPECT_EQ(Indices(Open(start, 2), static_cast<int>(rest.size() / 2)), rest) << start;
  }
}

TEST_F(DatasetSamplesTest, AReadersExceptionReachesTheCaller) {
  const auto source = Open(0, 2);
  WriteFileAtomically(folder_ / "000002/00000024_depth.png", "no picture");
  ExpectError<DataError>([&] { Indices(source, 11); }, {"00000024_depth.png"});
}

TEST_F(DatasetSamplesTest, RejectsBadBatches) {
  ExpectError<ConfigError>([&] { CountBatches(*dataset_, 3); },
                           {"run.batch_size = 3", folder_.path().string()});
  EXPECT_EQ(CountBatches(*dataset_, 1), 24u);
  EXPECT_THROW(Open(3, 1), Error);
  EXPECT_THROW(Open(0, 0), Error);
}

TEST(TrainOnADataset, SaysWhatDoesNotFit) {
  const TempFolder folder;
  const auto at = [&](const std::string& key, const char* name) {
    return key + "=" + (folder / name).string();
  };
  const auto expect = [&](std::vector<std::string> changes,
                          std::initializer_list<std::string> parts) {
    changes.insert(changes.begin(), at("run.dataset", "train"));
    ExpectError<ConfigError>([&] { Train(SmallRecipe(changes), QuietRun(folder / "run")); }, parts);
    EXPECT_FALSE(fs::exists(folder / "run"));
  };
  const TrainConfig missing = SmallRecipe({at("run.dataset", "missing")});
  ExpectError<IoError>([&] { Train(missing, QuietRun(folder / "run")); },
                       {missing.run.dataset, "volalign render"});
  const TrainConfig config = SmallRecipe();
  Write(folder / "train", config, 7, 3, 1);
  Write(folder / "valid", config, 7, 4, 3);
  Write(folder / "valid2", config, 9, 4, 4);
  folder.Write(
      "other.yaml",
      "name: other\nboxes:\n  - {name: a, x: [-300, 300], y: [-800, 0], z: [-200, 200]}\n");
  expect({"data.noise.models=[paper]"},
         {(folder / "train").string(), "data.noise.models = paper (dataset: sensor)"});
  expect({at("data.structure", "other.yaml")}, {"run.dataset", "structure", "other.yaml"});
  expect({"run.batch_size=4"}, {"run.batch_size = 4"});
  expect({"data.image_sizes=[64x36, 40x36]"}, {"data.image_sizes"});
  expect({"run.validation_seed=7"}, {"validation would see training samples", "seed 7"});
  expect({at("run.validation_dataset", "valid"), "run.validation_samples=2"},
         {"validation would see training samples", "training 1 to 3", "validation 3 to 6"});
  expect({at("run.validation_dataset", "valid2"), "run.validation_samples=5"},
         {"run.validation_samples = 5", "the 4 samples"});
  const std::vector<std::string> single = {at("run.dataset", "few"), "run.batch_size=4",
                                           "data.sensors=[azure_kinect_nfov_binned]",
                                           "data.image_sizes=[40x36]"};
  Write(folder / "few", SmallRecipe(single), 9, 3);
  expect(single, {"few", "3 samples", "run.batch_size = 4"});
}

}  // namespace
}  // namespace volalign::dataset_test
