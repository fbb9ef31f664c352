#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/nn/cpu/torch_threads.h"
#include "tests/core/base/temp_folder.h"
#include "train/trainer.h"

namespace volalign::rendered_training_test {
namespace {

using nlohmann::json;

std::vector<json> TrainRows(const std::filesystem::path& folder) {
  std::vector<json> rows;
  std::istringstream text(ReadFile(folder / "metrics.jsonl"));
  for (std::string line; std::getline(text, line);) {
    const json row = json::parse(line);
    if (row.at("type") == "train") rows.push_back(row);
  }
  return rows;
}

TEST(Train, RenderedRunResumesWithTheSameSamples) {
  SetTorchThreads(1);
  const TempFolder folder;
  ConfigSource source = ConfigSource::FromFile("configs/m05-lite.yaml");
  for (const char* assignment :
       {"model.base_channels=2", "model.residual_blocks=1", "data.image_sizes=[40x36, 64x36]",
        "run.batch_size=2", "run.samples=24", "run.log_every=2", "run.validation_samples=2",
        "optim.warmup_samples=4", "loss.min_side_pixels=3"}) {
    source.Set(assignment);
  }
  TrainConfig config = ReadTrainConfig(source);
  TrainOptions options;
  options.quiet = true;
  options.run_dir = folder / "whole";
  EXPECT_TRUE(Train(config, options).finished);
  options.run_dir = folder / "parts";
  options.stop_at_samples = 10;
  EXPECT_FALSE(Train(config, options).finished);
  config.run.loader_threads = 2;  // changes no sample
  options.stop_at_samples = 0;
  options.resume = true;
  EXPECT_TRUE(Train(config, options).finished);
  const std::vector<json> a = TrainRows(folder / "whole"), b = TrainRows(folder / "parts");
  ASSERT_EQ(a.size(), 12u);
  ASSERT_EQ(b.size(), 12u);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].at("loss"), b[i].at("loss")) << "step " << i + 1;
    EXPECT_EQ(a[i].at("lr"), b[i].at("lr")) << "step " << i + 1;
  }
}

}  // namespace
}  // namespace volalign::rendered_training_test
