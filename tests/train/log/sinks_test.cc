#include "train/log/sinks.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "train/log/event_file.h"
#include "train/log/metrics.h"

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
  row.mean.degenerate_samples = 3;
  row.mean.times.backward = 0.125;
  return row;
}

/// The row's keys of `expected` have these values.
void ExpectHas(json row, const std::string& expected) {
  const json before = row;
  row.update(json::parse(expected));
  EXPECT_EQ(before, row);
}

TEST(JsonlSink, WritesARowALine) {
  const TempFolder folder;
  JsonlSink sink(folder / "metrics.jsonl", 0);
  sink.Train(RowAt(20));
  ValidationRow validation;
  validation.samples = 20;
  validation.result.samples = 4;
  validation.result.means["miou"] = 0.75;
  sink.Validation(validation);
  validation.result.means["keypoint_rmse_m"] = 0.5;
  validation.result.samples_with_pose = 2;
  sink.Validation(validation);
  const std::vector<json> rows = Rows(folder / "metrics.jsonl");
  ASSERT_EQ(rows.size(), 3u);
  ExpectHas(rows[0], R"({"type": "train", "step": 10, "samples": 20, "loss": 0.25,
      "loss_mine": 1.5, "degenerate": 3, "skipped": 0, "lr": 0.5, "samples_per_s": 7})");
  EXPECT_EQ(rows[0]["step_s"]["backward"], 0.125);
  ExpectHas(rows[1], R"({"type": "validation", "validation_samples": 4, "miou": 0.75})");
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
    validation.result.means["miou"] = 0.75;
    sink.Validation(validation);
    sink.Train(RowAt(60));
  }
  const std::string text = testing::internal::GetCapturedStderr();
  for (const char* part :
       {"validation at 20:", " 30.0 %  60/200", "mIoU 0.750  7.0", "about 20 seconds left"})
    EXPECT_TRUE(Has(text, part));
}

TEST(LabelPictures, HaveARowForEachExample) {
  LabelImage labels(4, 3), predicted(4, 3);
  labels(1, 2) = 5;
  predicted(1, 2) = 7;
  const RgbImage picture = LabelPictures({{DepthImage(4, 3), LabelImage(4, 3), LabelImage(4, 3)},
                                          {DepthImage(4, 3, 1.0F), labels, predicted}});
  ASSERT_EQ(picture.width(), 3 * 4 + 2 * 2);
  ASSERT_EQ(picture.height(), 2 * 3 + 2);
  const Rgb black;
  // Of the second row: depth, labels, predicted labels; pixel (1, 2) of each.
  const Rgb depth = picture(1, 7), label = picture(7, 7), other = picture(13, 7);
  EXPECT_FALSE(depth == black);
  EXPECT_FALSE(label == black);
  EXPECT_FALSE(other == black);
  EXPECT_FALSE(label == other);
  EXPECT_EQ(picture(8, 7), black);
  EXPECT_EQ(picture(1, 2), black);  // nothing was measured in the first row
}

TEST(EventFile, LaterFilesSortAfterEarlierOnes) {
  const TempFolder folder;
  std::string before;
  for (int i = 0; i < 12; ++i) {
    const std::string name = EventFile(folder.path()).path().filename().string();
    EXPECT_LT(before, name);
    before = name;
  }
}

void ExpectTimes(const StepTimes& found, const StepTimes& expected) {
  for (double StepTimes::*part : {&StepTimes::data, &StepTimes::forward, &StepTimes::loss,
                                  &StepTimes::backward, &StepTimes::optim})
    EXPECT_NEAR(found.*part, expected.*part, 1e-12);
}

TEST(StepMeans, AreOverTheStepsAndTheirOwnTime) {
  StepMeans means;
  StepReport a, b;
  a.loss = 1;
  a.terms["loss_seg"] = 0.5;
  a.terms["loss_3d"] = 5;
  a.degenerate_samples = 1;
  a.gradient_norm = 10;
  a.times = {1, 2, 3, 4, 5};
  b.loss = 3;
  b.terms["loss_seg"] = 1.5;
  b.terms["loss_3d"] = 7;
  b.degenerate_samples = 2;
  b.gradient_norm = 30;
  b.times = {2, 3, 4, 5, 1};
  means.Add(a, 4);
  means.Add(b, 8);
  const TrainRow row = means.Take(20, 300, 0.01);
  EXPECT_EQ(row.step, 20);
  EXPECT_EQ(row.samples, 300);
  EXPECT_EQ(row.lr, 0.01);
  EXPECT_NEAR(row.samples_per_s, 12.0 / 30, 1e-12);  // in 15 s and 15 s
  EXPECT_EQ(row.mean.loss, 2);
  EXPECT_EQ(row.mean.terms.at("loss_seg"), 1);
  EXPECT_EQ(row.mean.terms.at("loss_3d"), 6);
  EXPECT_EQ(row.mean.degenerate_samples, 3);  // a sum
  EXPECT_EQ(row.mean.gradient_norm, 20);
  ExpectTimes(row.mean.times, {1.5, 2.5, 3.5, 4.5, 3});
  // The next row begins anew.
  means.Add(b, 8);
  EXPECT_EQ(means.Take(21, 308, 0.01).mean.loss, 3);
  // Steps that were skipped have times alone.
  StepReport skipped;
  skipped.skipped = 1;
  skipped.times = {1, 1, 1, 1, 1};
  means.Add(b, 8);
  means.Add(skipped, 4);
  const TrainRow with = means.Take(23, 320, 0.01);
  EXPECT_EQ(with.mean.steps, 2);
  EXPECT_EQ(with.mean.skipped, 1);
  EXPECT_EQ(with.mean.loss, 3);
  EXPECT_EQ(with.mean.times.data, 1.5);
  EXPECT_NEAR(with.samples_per_s, 12.0 / 20, 1e-12);
}

TEST(StepTimes, AreSharedOutAsMeasured) {
  // Ten steps, of which one was measured in 2 s without the data.
  const StepTimes all = ShareOut({5, 0, 0, 0, 10}, {9, 0.4, 0.4, 1.0, 0.2});
  ExpectTimes(all, {5, 2, 2, 5, 1});
  EXPECT_NEAR(Total(all), 15, 1e-12);
}

TEST(BestValidation, IsThatOfTheLargestMiou) {
  BestValidation best;
  const auto note = [&](double miou, std::int64_t at_samples) {
    ValidationResult result;
    result.means["miou"] = miou;
    return best.Note(result, at_samples);
  };
  EXPECT_FALSE(note(std::numeric_limits<double>::infinity(), 5));  // no value
  EXPECT_EQ(best.samples, -1);
  EXPECT_TRUE(note(0.5, 10));
  EXPECT_FALSE(note(0.5, 20));  // the earlier of equal ones stays
  EXPECT_FALSE(note(0.4, 30));
  EXPECT_EQ(best.samples, 10);
  EXPECT_TRUE(note(0.6, 40));
  EXPECT_EQ(best.value, 0.6);
}

}  // namespace
}  // namespace volalign::sinks_test
