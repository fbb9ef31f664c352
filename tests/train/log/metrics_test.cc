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
  a.terms["loss_seg"] = 0.5;
  a.terms["loss_3d"] = 5;
  a.degenerate = 1;
  a.gradient_norm = 10;
  a.times = {1, 2, 3, 4, 5};
  b.loss = 3;
  b.terms["loss_seg"] = 1.5;
  b.terms["loss_3d"] = 7;
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
  EXPECT_EQ(row.mean.terms.at("loss_seg"), 1);
  EXPECT_EQ(row.mean.terms.at("loss_3d"), 6);
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

TEST(BestValidation, IsThatOfTheLargestMiou) {
  BestValidation best;
  const auto note = [&](double miou, std::int64_t at_samples) {
    ValidationResult result;
    result.miou = miou;
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

// By its few lucky poses an early validation must not stay the best.
TEST(BestValidation, DoesNotGoByThePosesOfFewSamples) {
  BestValidation best;
  ValidationResult lucky, good;
  lucky.samples = good.samples = 192;
  lucky.posed = 2;
  lucky.miou = 0.1;
  lucky.median_translation_error_m = 0.01;
  good.posed = 180;
  good.miou = 0.6;
  good.median_translation_error_m = 0.03;
  EXPECT_TRUE(best.Note(lucky, 10));
  EXPECT_TRUE(best.Note(good, 20));
  EXPECT_EQ(best.samples, 20);
}

}  // namespace
}  // namespace volalign::metrics_test
