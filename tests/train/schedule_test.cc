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
}

}  // namespace
}  // namespace volalign::schedule_test
