#include "train/same_run.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/config/config.h"

namespace volalign::same_run_test {
namespace {

using Changes = std::vector<std::pair<std::string, std::string>>;

TrainConfig With(const Changes& changes) {
  ConfigSource source;
  for (const auto& [key, value] : changes) source.Set(key + "=" + value);
  return ReadConfig<TrainConfig>(source);
}

std::string Saved(const Changes& changes = {}) { return WriteConfig(With(changes)); }

/// The error that a resumed run gives; empty where there is none.
std::string Refusal(const std::string& saved, const TrainConfig& config) {
  try {
    RequireSameRun(saved, config, "old.state");
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

TEST(RequireSameRun, LetsThroughWhatChangesNoSampleAndNoStep) {
  EXPECT_EQ(Refusal(Saved(), With({})), "");
  const Changes free = {{"data.renderer", "cpu"},
                        {"run.samples", "77"},
                        {"run.validation_samples", "7"},
                        {"run.validate_every", "7"},
                        {"run.checkpoint_every", "7"},
                        {"run.tensorboard", "false"},
                        {"run.log_every", "7"},
                        {"run.threads", "7"},
                        {"run.loader_threads", "7"},
                        {"run.device", "cuda:1"},
                        {"run.lost_after_s", "7"},
                        {"run.dataset", "elsewhere"},
                        {"run.validation_dataset", "elsewhere"}};
  for (const auto& change : free) EXPECT_EQ(Refusal(Saved(), With({change})), "") << change.first;
  EXPECT_EQ(Refusal(Saved(), With(free)), "") << "all together";
}

TEST(RequireSameRun, NamesWhatWouldMakeItAnotherRun) {
  const Changes bound = {{"run.seed", "7"},
                         {"run.batch_size", "7"},
                         {"run.micro_batch", "2"},
                         {"run.init", "weights.pt"},
                         {"run.validation_seed", "7"},
                         {"run.precision", "bf16"},
                         {"run.channels_last", "true"},
                         {"optim.lr", "0.007"},
                         {"optim.optimizer", "adamw"},
                         {"optim.ema_decay", "0.7"},
                         {"loss.lambda", "7"},
                         {"model.base_channels", "7"},
                         {"model.normalization", "batch"},
                         {"data.noise.models", "none"}};
  for (const auto& [key, value] : bound) {
    const std::string refusal = Refusal(Saved(), With({{key, value}}));
    EXPECT_NE(refusal.find(key + " = "), std::string::npos) << key << ": " << refusal;
    EXPECT_NE(refusal.find("old.state"), std::string::npos) << key << ": " << refusal;
    EXPECT_EQ(Refusal(Saved({{key, value}}), With({{key, value}})), "") << key;
  }
  // Both values, the new one first.
  EXPECT_NE(Refusal(Saved({{"run.seed", "5"}}), With({{"run.seed", "7"}})).find("7 differs from 5"),
            std::string::npos);
}

TEST(RequireSameRun, TheLengthIsBoundWhereTheLearningRateFollowsIt) {
  for (const bool bound : {false, true}) {
    const Changes schedule = {{"optim.schedule", bound ? "one_cycle" : "constant"}};
    Changes longer = schedule;
    longer.emplace_back("run.samples", "123456");
    const std::string refusal = Refusal(Saved(schedule), With(longer));
    EXPECT_EQ(refusal.find("learning rate") != std::string::npos, bound) << refusal;
    EXPECT_EQ(refusal.empty(), !bound) << refusal;
  }
}

// A state of before a key existed: it ran as the default does.
TEST(RequireSameRun, AKeyThatIsNotThereHadItsDefault) {
  EXPECT_EQ(Refusal("run: {seed: 1}\n", With({{"run.seed", "1"}})), "");
  EXPECT_NE(Refusal("run: {seed: 1}\n", With({{"optim.clip_norm", "5"}})), "");
}

TEST(SameValidation, IsThatOfTheSameSamples) {
  EXPECT_TRUE(SameValidation(Saved(), With({})));
  EXPECT_TRUE(SameValidation(Saved(), With({{"run.validate_every", "7"}})));
  EXPECT_TRUE(SameValidation(Saved(), With({{"run.samples", "77"}})));
  for (const auto& change :
       Changes{{"run.validation_samples", "7"}, {"run.validation_dataset", "elsewhere"}})
    EXPECT_FALSE(SameValidation(Saved(), With({change}))) << change.first;
}

}  // namespace
}  // namespace volalign::same_run_test
