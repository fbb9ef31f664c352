#include "train/log/sinks.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::sinks_test {
namespace {

using nlohmann::json;

std::vector<json> Rows(const std::filesystem::path& path) {
  std::vector<json> rows;
  std::istringstream text(ReadFile(path));
  for (std::string line; std::getline(text, line);) rows.push_back(json::parse(line));
  return rows;
}

TrainRow RowAt(std::int64_t samples) {
  TrainRow row;
  row.step = samples / 2;
  row.samples = samples;
  row.lr = 0.5;
  row.samples_per_s = 7;
  row.mean.loss = 0.25;
  row.mean.terms = {{"loss_mine", 1.5}};
  row.mean.degenerate = 3;
  row.mean.times.backward = 0.125;
  return row;
}

TEST(JsonlSink, WritesARowALine) {
  const TempFolder folder;
  JsonlSink sink(folder / "metrics.jsonl", 0);
  sink.Train(RowAt(20));
  ValidationRow validation;
  validation.samples = 20;
  validation.result.samples = 4;
  validation.result.miou = 0.75;
  validation.result.keypoint_rmse_m = 0.5;
  sink.Validation(validation);
  validation.result.posed = 2;
  sink.Validation(validation);
  const std::vector<json> rows = Rows(folder / "metrics.jsonl");
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_EQ(rows[0]["type"], "train");
  EXPECT_EQ(rows[0]["step"], 10);
  EXPECT_EQ(rows[0]["samples"], 20);
  EXPECT_EQ(rows[0]["loss"], 0.25);
  EXPECT_EQ(rows[0]["loss_mine"], 1.5);
  EXPECT_EQ(rows[0]["degenerate"], 3);
  EXPECT_EQ(rows[0]["skipped"], 0);
  EXPECT_EQ(rows[0]["lr"], 0.5);
  EXPECT_EQ(rows[0]["samples_per_s"], 7);
  EXPECT_EQ(rows[0]["step_s"]["backward"], 0.125);
  EXPECT_EQ(rows[1]["type"], "validation");
  EXPECT_EQ(rows[1]["validation_samples"], 4);
  EXPECT_EQ(rows[1]["miou"], 0.75);
  EXPECT_FALSE(rows[1].contains("keypoint_rmse_m"));  // no sample has a pose
  EXPECT_EQ(rows[2]["keypoint_rmse_m"], 0.5);
}

TEST(JsonlSink, ContinuesAfterTheRowsUpToAState) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "metrics.jsonl";
  {
    JsonlSink sink(path, 0);
    for (const int samples : {10, 20, 30}) sink.Train(RowAt(samples));
  }
  // Rows that no sink wrote, and one in the middle of which the run was killed.
  WriteFileAtomically(path, ReadFile(path) +
                                "{\"samples\":\"x\"}\n{\"samples\":1e300}\n[1]\n"
                                "{\"type\":\"tr");
  {
    JsonlSink sink(path, 20);
    sink.Train(RowAt(25));
  }
  std::vector<int> samples;
  for (const json& row : Rows(path)) samples.push_back(row["samples"]);
  EXPECT_EQ(samples, (std::vector<int>{10, 20, 25}));
  { const JsonlSink anew(path, 0); }
  EXPECT_EQ(ReadFile(path), "");
  EXPECT_THROW(JsonlSink(path / "below", 0), Error);  // of a file
}

TEST(ProgressSink, SaysHowFarTheRunIs) {
  testing::internal::CaptureStderr();
  {
    ProgressSink sink(200);
    ValidationRow validation;
    validation.samples = 20;
    validation.result.miou = 0.75;
    sink.Validation(validation);
    sink.Train(RowAt(60));
  }
  const std::string text = testing::internal::GetCapturedStderr();
  for (const char* part :
       {"validation at 20:", " 30.0 %  60/200", "mIoU 0.750  7.0", "about 20 seconds left"})
    EXPECT_NE(text.find(part), std::string::npos) << part << " is not in: " << text;
}

}  // namespace
}  // namespace volalign::sinks_test
