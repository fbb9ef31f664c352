#include "train/schedule.h"

#include <gtest/gtest.h>

namespace volalign::schedule_test {
namespace {

TEST(LearningRate, FollowsTheSchedule) {
  OptimConfig config;
  config.lr = 1e-3;
  EXPECT_EQ(LearningRate(config, 0, 1000), 1e-3);
  EXPECT_EQ(LearningRate(config, 999, 1000), 1e-3);
  config.schedule = Schedule::kOneCycle;
  config.warmup_samples = 99;
  EXPECT_NEAR(LearningRate(config, 0, 1099), 1e-5, 1e-12);
  EXPECT_NEAR(LearningRate(config, 49, 1099), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 99, 1099), 1e-3, 1e-12);
  EXPECT_NEAR(LearningRate(config, 599, 1099), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 1099, 1099), 0, 1e-12);
  EXPECT_NEAR(LearningRate(config, 5000, 1099), 0, 1e-12);
  config.min_lr = 2e-4;
  EXPECT_NEAR(LearningRate(config, 599, 1099), 6e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 5000, 1099), 2e-4, 1e-12);
}

TEST(LearningRate, CosineBeginsAgainAfterEachPeriod) {
  OptimConfig config;
  config.lr = 1e-3;
  config.warmup_samples = 100;
  config.schedule = Schedule::kCosine;
  EXPECT_TRUE(config.DependsOnLength());
  EXPECT_NEAR(LearningRate(config, 600, 1100), 5e-4, 1e-12);
  EXPECT_NEAR(LearningRate(config, 1100, 1100), 0, 1e-12);
  config.period_samples = 400;
  EXPECT_FALSE(config.DependsOnLength());
  for (const std::int64_t total : {500, 5000}) {
    EXPECT_NEAR(LearningRate(config, 50, total), 1e-3 * 51 / 101, 1e-12);
    EXPECT_NEAR(LearningRate(config, 300, total), 5e-4, 1e-12);
    EXPECT_NEAR(LearningRate(config, 499, total), 0, 2e-8);
    EXPECT_NEAR(LearningRate(config, 500, total), 1e-3, 1e-12);
    EXPECT_NEAR(LearningRate(config, 700, total), 5e-4, 1e-12);
  }
}

TEST(LearningRate, StepFallsAtEachPeriod) {
  OptimConfig config;
  config.lr = 1e-2;
  config.warmup_samples = 10;
  config.schedule = Schedule::kStep;
  config.period_samples = 100;
  config.step_factor = 0.5;
  EXPECT_FALSE(config.DependsOnLength());
  EXPECT_NEAR(LearningRate(config, 109, 1000), 1e-2, 1e-15);
  EXPECT_NEAR(LearningRate(config, 110, 1000), 5e-3, 1e-15);
  EXPECT_NEAR(LearningRate(config, 209, 1000), 5e-3, 1e-15);
  EXPECT_NEAR(LearningRate(config, 310, 1000), 1.25e-3, 1e-15);
}

}  // namespace
}  // namespace volalign::schedule_test
