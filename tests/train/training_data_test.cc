#include "train/training_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/error.h"
#include "render/sample.h"
#include "tests/core/base/pixels.h"
#include "tests/render/expect_equal.h"
#include "tests/train/synthetic_source.h"
#include "train/batch.h"

namespace volalign::training_data_test {
namespace {

void ExpectSame(const std::vector<Sample>& a, const std::vector<Sample>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) ExpectEqual(a[i], b[i]);
}

TEST(OpenTrainingData, SamplesDependOnSeedAndNumberAlone) {
  TrainConfig config = SmallRecipe();
  const TrainingData data = OpenTrainingData(config);
  EXPECT_EQ(data.structure.Hash(), ReadStructure("configs/structure.yaml").Hash());
  EXPECT_EQ(data.identity, "");
  const auto from_start = data.open_training(0);
  const std::vector<Sample> first = from_start(), second = from_start();
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].index, 0u);
  EXPECT_EQ(second[0].index, 2u);
  EXPECT_FALSE(first[0].depth == second[0].depth);
  ExpectSame(data.open_training(2)(), second);
  // Of another process: its slice of each batch.
  ExpectSame(OpenTrainingData(config, {1, 1}).open_training(2)(), {second[1]});

  const std::vector<Sample> held_out = data.open_validation()();
  ExpectSame(data.open_validation()(), held_out);
  EXPECT_FALSE(held_out[0].depth == first[0].depth);
  config.run.validation_seed = 5;
  config.run.seed = 6;
  const TrainingData other = OpenTrainingData(config);
  EXPECT_FALSE(other.open_validation()()[0].depth == held_out[0].depth);
  EXPECT_FALSE(other.open_training(0)()[0].depth == first[0].depth);
}

Sample Blank(const Intrinsics& k) {
  Sample s;
  s.intrinsics = k;
  s.depth = DepthImage(k.width, k.height, 2.0F);
  s.labels = LabelImage(k.width, k.height, 3);
  return s;
}

TEST(Collate, RaysAreThoseOfEachSamplesLens) {
  const Intrinsics pinhole{24, 20, 21, 22, 11.3, 9.1, {}};
  Intrinsics lens = pinhole;
  lens.distortion = {-0.3, 0.05, 0, 0};
  const Batch batch = Collate({Blank(pinhole), Blank(lens)});
  ASSERT_EQ(batch.rays.sizes(), at::IntArrayRef({2, 2, 20, 24}));
  for (const auto [u, v] : Pixels(24, 20)) {
    const double xd = (u - 11.3) / 21, yd = (v - 9.1) / 22;
    EXPECT_NEAR(batch.rays[0][0][v][u].item<float>(), xd, 1e-6);
    EXPECT_NEAR(batch.rays[0][1][v][u].item<float>(), yd, 1e-6);
    // OpenCV's model, forwards.
    const double x = batch.rays[1][0][v][u].item<float>();
    const double y = batch.rays[1][1][v][u].item<float>();
    const double r2 = x * x + y * y, radial = 1 - 0.3 * r2 + 0.05 * r2 * r2;
    EXPECT_NEAR(x * radial, xd, 1e-6);
    EXPECT_NEAR(y * radial, yd, 1e-6);
  }
}

TEST(Collate, PixelsBeyondALensesFoldHaveNoDepth) {
  // r (1 - 0.5 r^2) rises up to 0.5443.
  const Intrinsics k{24, 20, 22, 22, 11.5, 9.5, {-0.5, 0, 0, 0}};
  const Batch batch = Collate({Blank(k)});
  int without = 0;
  for (const auto [u, v] : Pixels(24, 20)) {
    const bool folded = std::hypot(u - 11.5, v - 9.5) / 22 > 0.5443;
    EXPECT_EQ(batch.depth[0][0][v][u].item<float>(), folded ? 0.0F : 2.0F) << u << " " << v;
    EXPECT_TRUE(std::isfinite(batch.rays[0][0][v][u].item<float>()));
    without += folded;
  }
  EXPECT_GT(without, 20);
}

TEST(BatchPacker, HasTheSamplesValues) {
  const Intrinsics k{24, 20, 22, 22, 11.5, 9.5, {}};
  Sample first = Blank(k);
  const Sample second = Blank(k);
  for (std::size_t i = 0; i < first.depth.size(); ++i) {
    first.depth[i] = static_cast<float>(i) * 0.0123F;
    first.labels[i] = static_cast<std::uint8_t>(i % 256);
  }
  const Batch batch = Collate({first, second});
  EXPECT_EQ(batch.cameras, (std::vector<Intrinsics>{k, k}));
  std::size_t at = 0;
  for (const Sample& sample : {first, second}) {
    const float* depth = batch.depth.data_ptr<float>() + at;
    const std::int64_t* labels = batch.labels.data_ptr<std::int64_t>() + at;
    EXPECT_TRUE(std::equal(sample.depth.begin(), sample.depth.end(), depth));
    EXPECT_TRUE(std::equal(sample.labels.begin(), sample.labels.end(), labels));
    at += sample.depth.size();
  }
}

TEST(BatchPacker, ForgetsCamerasOfWhichThereAreMany) {
  BatchPacker packer(at::kCPU);
  for (int round = 0; round < 2; ++round) {
    for (int i = 0; i < 100; ++i) {
      const Intrinsics k{24, 20, 22.0 + i, 22, 11.5, 9.5, {}};
      const Batch batch = Unpack(packer.Pack({Blank(k), Blank(k)}));
      EXPECT_NEAR(batch.rays[1][0][3][2].item<float>(), (2 - 11.5) / (22 + i), 1e-6);
    }
  }
}

TEST(FeedBatches, GivesWhatTheSourceDoesHoweverFarAhead) {
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  const SampleSource source = data.open_training(4);
  const auto now = FeedBatches(data.open_training(4), at::kCPU, 0),
             ahead = FeedBatches(data.open_training(4), at::kCPU, 2);
  for (int i = 0; i < 6; ++i) {
    const Batch expected = Collate(source());
    for (const auto* next : {&now, &ahead}) {
      const Batch fed = (*next)();
      EXPECT_TRUE(fed.depth.equal(expected.depth));
      EXPECT_TRUE(fed.labels.equal(expected.labels));
      EXPECT_TRUE(fed.rays.equal(expected.rays));
      EXPECT_EQ(fed.cameras.size(), 2u);
    }
  }
}

TEST(FeedBatches, PassesOnWhatTheSourceThrows) {
  const SampleSource failing = []() -> std::vector<Sample> { throw IoError("gone"); };
  for (const int ahead : {0, 2}) EXPECT_THROW(FeedBatches(failing, at::kCPU, ahead)(), IoError);
}

TEST(Collate, ImagesOfOtherSizesAreAnError) {
  const Intrinsics k{24, 20, 22, 22, 11.5, 9.5, {}};
  Sample other = Blank(k);
  other.intrinsics.width = 23;
  EXPECT_THROW(Collate({Blank(k), other}), Error);
  EXPECT_THROW(Collate({}), Error);
}

}  // namespace
}  // namespace volalign::training_data_test
