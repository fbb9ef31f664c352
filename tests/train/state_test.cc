#include "train/state.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::state_test {
namespace {

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
  EXPECT_EQ(progress.means.sum.degenerate, 7);
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

}  // namespace
}  // namespace volalign::state_test
