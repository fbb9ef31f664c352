#include "train/log/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace volalign::metrics_test {
namespace {

TEST(StepMeans, AreOverTheStepsAndTheirOwnTime) {
  StepMeans means;
  StepReport a, b;
  a.loss = 1;
  a.loss_seg = 0.5;
  a.loss_3d = 5;
  a.degenerate = 1;
  a.gradient_norm = 10;
  a.times = {1, 2, 3, 4, 5};
  b.loss = 3;
  b.loss_seg = 1.5;
  b.loss_3d = 7;
  b.degenerate = 2;
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
  EXPECT_EQ(row.mean.loss_seg, 1);
  EXPECT_EQ(row.mean.loss_3d, 6);
  EXPECT_EQ(row.mean.degenerate, 3);  // a sum
  EXPECT_EQ(row.mean.gradient_norm, 20);
  EXPECT_EQ(row.mean.times.data, 1.5);
  EXPECT_EQ(row.mean.times.forward, 2.5);
  EXPECT_EQ(row.mean.times.loss, 3.5);
  EXPECT_EQ(row.mean.times.backward, 4.5);
  EXPECT_EQ(row.mean.times.optim, 3);
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
  EXPECT_EQ(all.data, 5);
  EXPECT_NEAR(all.forward, 2, 1e-12);
  EXPECT_NEAR(all.loss, 2, 1e-12);
  EXPECT_NEAR(all.backward, 5, 1e-12);
  EXPECT_NEAR(all.optim, 1, 1e-12);
  EXPECT_NEAR(Total(all), 15, 1e-12);
}

TEST(BestMetric, NamesAValueAndItsDirection) {
  ValidationResult result;
  result.loss_seg = 1;
  result.miou = 2;
  result.miou_authors = 3;
  result.keypoint_rmse_m = 4;
  result.median_translation_error_m = 5;
  result.median_rotation_error_deg = 6;
  result.posed = 1;
  for (std::size_t i = 0; i < kBestMetrics.size(); ++i) {
    const BestMetric metric = kBestMetrics[i].second;
    BestValidation best;
    EXPECT_TRUE(best.Note(metric, result, 10));
    EXPECT_EQ(best.value, static_cast<double>(i + 1)) << kBestMetrics[i].first;
    EXPECT_EQ(LargerIsBetter(metric), i == 1 || i == 2) << kBestMetrics[i].first;
  }
  // Errors of poses mean nothing where no sample has one.
  result.posed = 0;
  for (std::size_t i = 0; i < kBestMetrics.size(); ++i)
    EXPECT_EQ(BestValidation().Note(kBestMetrics[i].second, result, 10), i < 3);
  EXPECT_EQ(MedianPoseError(result), "-");
}

ValidationResult Result(double loss_seg, double miou) {
  ValidationResult result;
  result.loss_seg = loss_seg;
  result.miou = miou;
  return result;
}

TEST(BestValidation, IsTheSmallestLossOrTheLargestIou) {
  BestValidation loss, iou;
  EXPECT_TRUE(loss.Note(BestMetric::kLossSeg, Result(0.5, 0.5), 10));
  EXPECT_TRUE(iou.Note(BestMetric::kMiou, Result(0.5, 0.5), 10));
  EXPECT_FALSE(loss.Note(BestMetric::kLossSeg, Result(0.6, 0.6), 20));
  EXPECT_TRUE(iou.Note(BestMetric::kMiou, Result(0.6, 0.6), 20));
  EXPECT_EQ(loss.samples, 10);
  EXPECT_EQ(loss.value, 0.5);
  EXPECT_EQ(loss.since, 1);
  EXPECT_EQ(iou.samples, 20);
  EXPECT_EQ(iou.value, 0.6);
  EXPECT_EQ(iou.since, 0);
}

TEST(BestValidation, TheEarlierOfEqualOnesStaysAndWorseOnesAreCounted) {
  BestValidation best;
  EXPECT_TRUE(best.Note(BestMetric::kMiou, Result(0, 0.5), 10));
  EXPECT_FALSE(best.Note(BestMetric::kMiou, Result(0, 0.5), 20));
  EXPECT_FALSE(best.Note(BestMetric::kMiou, Result(0, 0.4), 30));
  EXPECT_EQ(best.samples, 10);
  EXPECT_EQ(best.since, 2);
  EXPECT_TRUE(best.Note(BestMetric::kMiou, Result(0, 0.6), 40));
  EXPECT_EQ(best.since, 0);
}

TEST(BestValidation, OneThatHasNoValueIsNeverTheBest) {
  BestValidation best;
  ValidationResult posed = Result(0, 0);
  posed.keypoint_rmse_m = 0.3;
  EXPECT_FALSE(best.Note(BestMetric::kKeypointRmse, posed, 10));  // no sample has a pose
  EXPECT_EQ(best.samples, -1);
  posed.posed = 1;
  EXPECT_TRUE(best.Note(BestMetric::kKeypointRmse, posed, 20));
  EXPECT_FALSE(
      best.Note(BestMetric::kLossSeg, Result(-std::numeric_limits<double>::infinity(), 0), 30));
  EXPECT_EQ(best.samples, 20);
}

}  // namespace
}  // namespace volalign::metrics_test
