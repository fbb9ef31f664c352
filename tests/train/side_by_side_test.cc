#include <gtest/gtest.h>

#include <csignal>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/nn/cpu/torch_threads.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/synthetic_source.h"
#include "train/trainer.h"

namespace volalign::side_by_side_test {
namespace {

namespace fs = std::filesystem;

TrainConfig TinyConfig() {
  TrainConfig config;
  config.model.base_channels = 2;
  config.model.residual_blocks = 1;
  config.model.normalization = "batch";
  config.loss.min_side_pixels = 5;
  config.optim.ema_decay = 0.9;
  config.run.samples = 20;
  config.run.batch_size = 2;
  config.run.log_every = 4;
  config.run.checkpoint_every = 6;
  config.run.validate_every = 10;
  config.run.validation_samples = 2;
  config.run.tensorboard = false;
  SetTorchThreads(1);
  return config;
}

/// As m01, m02 and m03 differ, and by the seed of the weights.
std::vector<TrainConfig> Models() {
  std::vector<TrainConfig> models(4, TinyConfig());
  models[0].model.attention = false;
  models[0].loss.procrustes = false;
  models[1].loss.procrustes = false;
  models[3].run.weight_seed = 7;
  return models;
}

TrainJob Job(const TrainConfig& config, const fs::path& dir) {
  TrainJob job{config, {}};
  job.options.run_dir = dir;
  job.options.quiet = true;
  return job;
}

std::vector<TrainJob> Jobs(const fs::path& dir) {
  std::vector<TrainJob> jobs;
  for (const TrainConfig& config : Models())
    jobs.push_back(Job(config, dir / std::to_string(jobs.size())));
  return jobs;
}

const TrainingData& Data() {
  static const TrainingData data = SyntheticData(2, 32, 1u << 20);
  return data;
}

void ExpectSameRuns(const fs::path& a, const fs::path& b) {
  for (std::size_t i = 0; i < Models().size(); ++i) {
    for (const char* file : {"model.pt", "best.pt", "states/000000000020.state"}) {
      const std::string run = std::to_string(i);
      EXPECT_TRUE(ReadFile(a / run / file) == ReadFile(b / run / file)) << run << " " << file;
    }
  }
}

class SideBySide : public testing::Test {
 protected:
  SideBySide() {
    for (const TrainJob& job : Jobs(folder_ / "alone")) TrainOn(Data(), job.config, job.options);
  }
  TempFolder folder_;
};

TEST_F(SideBySide, EachHasTheWeightsOfARunOfItsOwn) {
  int opened = 0;
  TrainingData counted = Data();
  counted.open_training = [&](std::int64_t first) {
    ++opened;
    return Data().open_training(first);
  };
  for (const JobResult& result : TrainSideBySideOn(counted, Jobs(folder_ / "together"))) {
    EXPECT_EQ(result.failure, "");
    EXPECT_TRUE(result.result.finished);
  }
  EXPECT_EQ(opened, 1);
  ExpectSameRuns(folder_ / "together", folder_ / "alone");
}

TEST_F(SideBySide, GoOnFromWhereEachWas) {
  std::vector<TrainJob> jobs = Jobs(folder_ / "together");
  // Interrupted, one of them further on than the others.
  for (TrainJob& job : jobs) job.options.stop_at_samples = 8;
  jobs[2].options.stop_at_samples = 12;
  for (const JobResult& result : TrainSideBySideOn(Data(), jobs))
    EXPECT_FALSE(result.result.finished);
  for (TrainJob& job : jobs) {
    job.options.stop_at_samples = 0;
    job.options.resume = true;
  }
  for (const JobResult& result : TrainSideBySideOn(Data(), jobs)) EXPECT_EQ(result.failure, "");
  ExpectSameRuns(folder_ / "together", folder_ / "alone");
}

TEST_F(SideBySide, OneThatFailsLeavesTheOthersAlone) {
  std::vector<TrainJob> jobs = Jobs(folder_ / "together");
  jobs.insert(jobs.begin(), Job(TinyConfig(), folder_ / "alone" / "0"));  // holds a run already
  const std::vector<JobResult> results = TrainSideBySideOn(Data(), jobs);
  EXPECT_NE(results[0].failure.find("--resume"), std::string::npos) << results[0].failure;
  ExpectSameRuns(folder_ / "together", folder_ / "alone");
}

TEST_F(SideBySide, StopTogetherAtASignal) {
  TrainingData stopping = Data();
  stopping.open_training = [](std::int64_t first) {
    struct Signalling : SampleSource {
      std::vector<Sample> Next() override {
        if (++calls == 3) std::raise(SIGTERM);
        return inner->Next();
      }
      std::unique_ptr<SampleSource> inner;
      int calls = 0;
    };
    auto source = std::make_unique<Signalling>();
    source->inner = Data().open_training(first);
    return source;
  };
  std::vector<TrainJob> jobs = Jobs(folder_ / "together");
  for (const JobResult& result : TrainSideBySideOn(stopping, jobs)) {
    EXPECT_EQ(result.result.signal, SIGTERM);
    EXPECT_EQ(result.result.samples, 6);
  }
  for (TrainJob& job : jobs) job.options.resume = true;
  TrainSideBySideOn(Data(), jobs);
  ExpectSameRuns(folder_ / "together", folder_ / "alone");
}

TEST(ShareSamples, WhereOnlyNetworkAndScheduleDiffer) {
  const TrainConfig one = TinyConfig();
  for (TrainConfig other : Models()) {
    other.optim.lr = 1e-3;
    other.run.samples = 400;
    EXPECT_TRUE(ShareSamples(one, other));
  }
  const auto differs = [&](auto change) {
    TrainConfig other = one;
    change(other);
    return !ShareSamples(one, other);
  };
  EXPECT_TRUE(differs([](TrainConfig& c) { c.data.pose.rho_cm = {150, 350}; }));
  EXPECT_TRUE(differs([](TrainConfig& c) { c.run.batch_size = 4; }));
  EXPECT_TRUE(differs([](TrainConfig& c) { c.run.seed = 2; }));
  EXPECT_TRUE(differs([](TrainConfig& c) { c.run.dataset = "data/train"; }));
}

}  // namespace
}  // namespace volalign::side_by_side_test
