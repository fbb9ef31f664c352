#include "train/saved_state.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "tests/core/base/expect_error.h"

namespace volalign::saved_state_test {
namespace {

using Changes = std::vector<std::string>;

/// As states of format 2 have it, written by hand.
constexpr char kProgress[] = R"({
  "samples": 4800, "init_samples": 9223372036854775807, "lr": 0.0002,
  "focal_px": [117.5, 126.25], "image_sizes": [[160, 90], [160, 144]], "validated": -1,
  "best": {"samples": 3200, "value": 0.125},
  "means": {"steps": 3, "samples": 48, "loss": 1.5, "loss_seg": 1.25, "loss_3d": 0.25,
            "degenerate": 7, "gradient_norm": 4.5, "times": [0.5, 1.0, 1.5, 2.0, 2.5],
            "skipped": 1}})";

TEST(RunProgress, IsReadFromAndWrittenToTheseKeys) {
  const RunProgress progress = ReadProgress(kProgress);
  EXPECT_EQ(progress.samples, 4800);
  EXPECT_EQ(progress.init_samples, 9223372036854775807);
  EXPECT_EQ(progress.lr, 0.0002);
  EXPECT_EQ(progress.focal_px, (std::pair{117.5, 126.25}));
  EXPECT_EQ(progress.image_sizes, (std::set<std::pair<int, int>>{{160, 90}, {160, 144}}));
  EXPECT_EQ(progress.validated, -1);
  EXPECT_EQ(progress.best.samples, 3200);
  EXPECT_EQ(progress.best.value, 0.125);
  EXPECT_EQ(progress.means.sum.steps, 3);
  EXPECT_EQ(progress.means.sum.skipped, 1);
  EXPECT_EQ(progress.means.samples, 48);
  EXPECT_EQ(progress.means.sum.terms.at("loss_3d"), 0.25);
  EXPECT_EQ(progress.means.sum.degenerate_samples, 7);
  EXPECT_EQ(progress.means.sum.times.data, 0.5);
  EXPECT_EQ(progress.means.sum.times.optim, 2.5);
  EXPECT_EQ(nlohmann::json::parse(WriteProgress(progress)), nlohmann::json::parse(kProgress));
}

TEST(RunProgress, HasTheTermsOfTheProgram) {
  nlohmann::json own = nlohmann::json::parse(kProgress);
  own["means"]["terms"] = {{"loss_mine", 0.5}};
  const RunProgress progress = ReadProgress(own.dump());
  EXPECT_EQ(progress.means.sum.terms.at("loss_mine"), 0.5);
  EXPECT_EQ(nlohmann::json::parse(WriteProgress(progress)), own);
}

TEST(RunProgress, OfAnEarlierVersionSkippedNoStep) {
  nlohmann::json earlier = nlohmann::json::parse(kProgress);
  earlier["means"].erase("skipped");
  EXPECT_EQ(ReadProgress(earlier.dump()).means.sum.skipped, 0);
}

TEST(RunProgress, SaysWhatIsWrong) {
  const auto expect = [](const std::string& pointer, const nlohmann::json& value,
                         std::initializer_list<std::string> parts) {
    nlohmann::json bad = nlohmann::json::parse(kProgress);
    bad[nlohmann::json::json_pointer(pointer)] = value;
    ExpectError<DataError>([&] { ReadProgress(bad.dump()); }, parts);
  };
  expect("/samples", 0.5, {"samples = 0.5", "whole"});
  expect("/image_sizes/1", {160}, {"image_sizes[1]", "1 elements, not 2"});
  expect("/means/times", {1, 2, 3, 4}, {"means: times", "4 numbers, not 5"});
  expect("/best/values", 1, {"best", "\"values\" is unknown"});
  ExpectError<DataError>([] { ReadProgress("{\"samples\": 1"); }, {"not valid JSON"});
}

TrainConfig With(const Changes& changes) {
  ConfigSource source;
  for (const std::string& change : changes) source.Set(change);
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
  const Changes free({"data.renderer=cpu", "run.samples=77", "run.validation_samples=7",
                      "run.validate_every=7", "run.checkpoint_every=7", "run.tensorboard=false",
                      "run.log_every=7", "run.threads=7", "run.loader_threads=7",
                      "run.device=cuda:1", "run.lost_after_s=7", "run.dataset=elsewhere",
                      "run.validation_dataset=elsewhere"});
  for (const std::string& change : free) EXPECT_EQ(Refusal(Saved(), With({change})), "") << change;
  EXPECT_EQ(Refusal(Saved(), With(free)), "") << "all together";
}

TEST(RequireSameRun, NamesWhatWouldMakeItAnotherRun) {
  for (const std::string change :
       {"run.seed=7", "run.batch_size=7", "run.micro_batch=2", "run.init=weights.pt",
        "run.validation_seed=7", "run.precision=bf16", "run.channels_last=true", "optim.lr=0.007",
        "optim.optimizer=adamw", "optim.ema_decay=0.7", "loss.lambda=7", "model.base_channels=7",
        "model.normalization=batch", "data.noise.models=none"}) {
    const std::string refusal = Refusal(Saved(), With({change}));
    EXPECT_TRUE(Has(refusal, change.substr(0, change.find('=')) + " = ", "old.state")) << change;
    EXPECT_EQ(Refusal(Saved({change}), With({change})), "") << change;
  }
  // Both values, the new one first.
  EXPECT_TRUE(Has(Refusal(Saved({"run.seed=5"}), With({"run.seed=7"})), "7 differs from 5"));
}

TEST(RequireSameRun, TheLengthIsBoundWhereTheLearningRateFollowsIt) {
  for (const bool bound : {false, true}) {
    const std::string schedule = bound ? "optim.schedule=one_cycle" : "optim.schedule=constant";
    const std::string refusal = Refusal(Saved({schedule}), With({schedule, "run.samples=123456"}));
    EXPECT_EQ(refusal.find("learning rate") != std::string::npos, bound) << refusal;
    EXPECT_EQ(refusal.empty(), !bound) << refusal;
  }
}

// A state of before a key existed: it ran as the default does.
TEST(RequireSameRun, AKeyThatIsNotThereHadItsDefault) {
  EXPECT_EQ(Refusal("run: {seed: 1}\n", With({"run.seed=1"})), "");
  EXPECT_NE(Refusal("run: {seed: 1}\n", With({"optim.clip_norm=5"})), "");
}

TEST(SameValidation, IsThatOfTheSameSamples) {
  EXPECT_TRUE(SameValidation(Saved(), With({})));
  EXPECT_TRUE(SameValidation(Saved(), With({"run.validate_every=7"})));
  EXPECT_TRUE(SameValidation(Saved(), With({"run.samples=77"})));
  for (const char* change : {"run.validation_samples=7", "run.validation_dataset=elsewhere"})
    EXPECT_FALSE(SameValidation(Saved(), With({change}))) << change;
}

}  // namespace
}  // namespace volalign::saved_state_test
