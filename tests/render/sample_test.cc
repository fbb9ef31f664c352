#include "render/sample.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "render/egl/renderers.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/render/expect_equal.h"
#include "tests/render/test_scene.h"

namespace volalign::sample_test {
namespace {

SampleConfig SmallConfig() {
  SampleConfig config;
  config.image_sizes = {"160x144", "160x90"};
  return config;
}

class SampleTest : public testing::Test {
 protected:
  const std::unique_ptr<DepthRenderer> owned_ = GlRenderers()();
  DepthRenderer& renderer_ = *owned_;
};

TEST_F(SampleTest, SwitchingNoiseOrClutterOffLeavesEverythingElse) {
  SampleConfig config = SmallConfig();
  const SampleContext sensor = MakeSampleContext(config, 4);
  config.noise.models = {"none"};
  const SampleContext none = MakeSampleContext(config, 4);
  config.noise.models = {"paper"};
  const SampleContext paper = MakeSampleContext(config, 4);
  config.scene = BareConfig().scene;
  const SampleContext bare = MakeSampleContext(config, 4);
  int hidden = 0;
  for (std::uint64_t i = 0; i < 6; ++i) {
    const Sample a = Synthesize(sensor, renderer_, 2, i);
    for (const SampleContext* context : {&none, &paper, &bare}) {
      const Sample other = Synthesize(*context, renderer_, 2, i);
      EXPECT_EQ(a.structure_from_sensor.matrix(), other.structure_from_sensor.matrix());
      EXPECT_TRUE(a.intrinsics == other.intrinsics);
      EXPECT_EQ(a.box_offsets[0].matrix(), other.box_offsets[0].matrix());
      EXPECT_EQ(a.size_scale, other.size_scale);
      EXPECT_EQ(a.depth_clean == other.depth_clean, context != &bare);
      if (context != &bare) EXPECT_TRUE(a.labels_clean == other.labels_clean);
      hidden += !(a.labels_clean == other.labels_clean);
      EXPECT_EQ(other.depth == other.depth_clean, context == &none);
      EXPECT_EQ(other.labels == other.labels_clean, context == &none);
    }
    EXPECT_FALSE(a.depth == a.depth_clean);
  }
  EXPECT_GE(hidden, 3) << "clutter hides a part of the structure in most samples";
  config.noise.models = {"paper", "physics"};
  ExpectError<ConfigError>([&] { MakeSampleContext(config, 4); }, {"physics", "first"});
}

TEST_F(SampleTest, ImageSizeIsOnePerBatchAndFitsTheSensor) {
  const SampleContext context = MakeSampleContext(SmallConfig(), 4);
  std::map<int, int> heights;
  for (std::uint64_t batch = 0; batch < 24; ++batch) {
    const Sample first = Synthesize(context, renderer_, 1, 4 * batch);
    const Sample last = Synthesize(context, renderer_, 1, 4 * batch + 3);
    EXPECT_EQ(first.depth.height(), last.depth.height());
    EXPECT_EQ(first.depth.width(), 160);
    EXPECT_EQ(first.intrinsics.height, first.depth.height());
    EXPECT_EQ(first.sensor,
              first.depth.height() == 90 ? "realsense_d415" : "azure_kinect_nfov_binned");
    // Half of the measured focal lengths at 320 px: about 235 (D415) and 252 (Azure Kinect).
    EXPECT_NEAR(first.intrinsics.fx, first.depth.height() == 90 ? 117.7 : 126.1, 0.5);
    ++heights[first.depth.height()];
  }
  EXPECT_GT(heights[90], 3);
  EXPECT_GT(heights[144], 3);
}

TEST_F(SampleTest, ExactBareSampleIsWhatTheRayCasterSees) {
  SampleConfig config = BareConfig();
  config.pose.roll_offsets_deg = {0, 90, 180, 270};
  const SampleContext context = MakeSampleContext(config, 4);
  long compared = 0, equal = 0;
  for (std::uint64_t i = 0; i < 8; ++i) {
    const Sample sample = Synthesize(context, renderer_, 4, i);
    const ExpectedView truth =
        CastView(context.structure, ComputeRays(sample.intrinsics), sample.structure_from_sensor);
    for (const auto [u, v] : Pixels(sample.depth)) {
      if (IsEdge(truth.labels, truth.depth, u, v)) continue;
      ++compared;
      equal += sample.labels(u, v) == truth.labels(u, v) &&
               std::abs(sample.depth(u, v) - truth.depth(u, v)) < 1e-4F;
    }
  }
  EXPECT_GT(compared, 100'000);
  EXPECT_GT(static_cast<double>(equal) / compared, 0.9995);
}

TEST_F(SampleTest, StructureIsSeldomHidden) {
  SampleConfig config = SmallConfig();
  config.assembly = {0, 0, 0};
  config.scene.occluder_probability = 1;
  config.scene.distractor_probability = 1;
  const SampleContext context = MakeSampleContext(config, 4);
  constexpr int kCount = 150;
  int visible = 0, half = 0;
  for (std::uint64_t i = 0; i < kCount; ++i) {
    const Sample sample = Synthesize(context, renderer_, 5, i);
    const ExpectedView bare =
        CastView(context.structure, ComputeRays(sample.intrinsics), sample.structure_from_sensor);
    long expected = 0, seen = 0;
    for (std::size_t k = 0; k < bare.labels.size(); ++k) {
      expected += bare.labels[k] != 0;
      seen += sample.labels_clean[k] != 0;
    }
    visible += seen > 0.25 * expected;
    half += seen > 0.6 * expected;
  }
  EXPECT_GE(visible, static_cast<int>(0.97 * kCount));
  EXPECT_GE(half, static_cast<int>(0.85 * kCount));
}

TEST(SampleContextTest, AMissingFileSaysWhereItWasLookedForAndHowToGiveAnother) {
  SampleConfig config;
  config.structure = "configs/no_structure.yaml";
  ExpectError<IoError>([&] { MakeSampleContext(config, 1); },
                       {"data.structure = configs/no_structure.yaml",
                        std::filesystem::current_path().string(), "name another file by this key"});
  config = SampleConfig();
  config.intrinsics = "/nowhere/intrinsics.yaml";
  ExpectError<IoError>([&] { MakeSampleContext(config, 1); },
                       {"data.intrinsics = /nowhere/intrinsics.yaml: no such file: run in"});
}

// The batch's size decides which sensors may be drawn; among them they are drawn evenly.
TEST_F(SampleTest, ASensorIsDrawnAmongThoseThatHaveTheAspectRatio) {
  SampleConfig config = BareConfig();
  config.sensors = {"realsense_d415", "kinect_v1", "azure_kinect_nfov_binned"};
  config.image_sizes = {"40x36", "64x36", "64x48"};
  const SampleContext context = MakeSampleContext(config, 1);
  std::map<std::pair<int, std::string>, int> counts;
  for (std::uint64_t i = 0; i < 120; ++i) {
    const Sample sample = Synthesize(context, renderer_, 9, i);
    ++counts[{sample.depth.width() * 100 + sample.depth.height(), sample.sensor}];
  }
  std::set<std::pair<int, std::string>> pairs;
  for (const auto& [pair, count] : counts) {
    pairs.insert(pair);
    EXPECT_GE(count, 8) << pair.first << " " << pair.second;
  }
  const std::set<std::pair<int, std::string>> expected = {{4036, "azure_kinect_nfov_binned"},
                                                          {6436, "realsense_d415"},
                                                          {6448, "realsense_d415"},
                                                          {6448, "kinect_v1"}};
  EXPECT_EQ(pairs, expected);
}

TEST(SampleContextTest, NamesWhatIsWrong) {
  const auto message = [](const SampleConfig& config) {
    return ExpectError<ConfigError>([&] { MakeSampleContext(config, 4); });
  };
  SampleConfig config;
  config.sensors = {"kinect_v9"};
  EXPECT_TRUE(Has(message(config), "kinect_v9"));
  config = SampleConfig();
  config.image_sizes = {"160x160"};
  EXPECT_TRUE(Has(message(config), "160x160"));
  // Each size has a sensor, but a sensor that is named has no size.
  config.image_sizes = {"160x144", "80x72"};
  for (const char* part : {"realsense_d415 (1280x720, 640x480)", "[160x144, 80x72]"})
    EXPECT_TRUE(Has(message(config), part));
  config.image_sizes = {"big"};
  EXPECT_TRUE(Has(message(config), "big"));
  config = SampleConfig();
  config.pose.rho_cm = {200, 100};
  EXPECT_EQ(message(config).rfind("data.pose.rho_cm = [200, 100]", 0), 0U) << message(config);
  config = SampleConfig();
  config.pose.phi_jitter_deg = 10;
  EXPECT_TRUE(Has(message(config), "phi_deg"));
  config = SampleConfig();
  EXPECT_NO_THROW(MakeSampleContext(config, 4));
  EXPECT_THROW(MakeSampleContext(config, 0), ConfigError);
}

constexpr double kDegree = 3.14159265358979323846 / 180;

TEST(PoseSamplerTest, IsUniformWithinThePapersRanges) {
  PoseConfig config;
  config.roll_offsets_deg = {0, 90, 180, 270};
  constexpr int kCount = 4000;
  double mean_rho = 0, mean_height = 0, miss = 0;
  std::array<int, 4> offsets{};
  std::array<int, 8> octants{};
  for (std::uint64_t i = 0; i < kCount; ++i) {
    RandomStream random(11, i, "pose");
    const Pose pose = SamplePose(config, random);
    const Eigen::Vector3d t = pose.translation();
    const double rho = std::hypot(t.x(), t.z());
    EXPECT_GE(rho, 1.50 - 1e-9);
    EXPECT_LE(rho, 2.75 + 1e-9);
    EXPECT_GE(t.y(), -0.15 - 1e-9);
    EXPECT_LE(t.y(), 0.75 + 1e-9);
    mean_rho += rho / kCount;
    mean_height += t.y() / kCount;
    const double phi = std::atan2(t.z(), t.x()) / kDegree + 180;
    ++octants[std::min<std::size_t>(static_cast<std::size_t>(phi / 45), 7)];
    EXPECT_NEAR(pose.linear().determinant(), 1, 1e-9);
    // The optical axis passes the ball of look-at points.
    const Eigen::Vector3d axis = pose.linear().col(2), off = t - t.dot(axis) * axis;
    EXPECT_LE(off.norm(), 0.20 + 1e-9);
    EXPECT_LT(t.dot(axis), 0);
    miss += off.squaredNorm() / kCount;
    // Roll: angle by which image -y (0), +x (90), +y (180), -x (270) ... miss the vertical. Down in
    // the image plane is at -roll from the image's y axis.
    const Eigen::Vector3d down = pose.linear().transpose() * Eigen::Vector3d(0, -1, 0);
    double roll = std::atan2(down.x(), down.y()) / kDegree;
    if (roll < -45) roll += 360;
    ++offsets[static_cast<std::size_t>(std::lround(roll / 90) % 4)];
    EXPECT_LE(std::abs(roll - 90 * std::lround(roll / 90)), 5 + 1e-6);
  }
  EXPECT_NEAR(mean_rho, 2.125, 5 * 1.25 / std::sqrt(12.0 * kCount));
  EXPECT_NEAR(mean_height, 0.30, 5 * 0.9 / std::sqrt(12.0 * kCount));
  for (const int count : offsets) EXPECT_NEAR(count, kCount / 4.0, 5 * std::sqrt(kCount / 4.0));
  for (const int count : octants) EXPECT_NEAR(count, kCount / 8.0, 5 * std::sqrt(kCount / 8.0));
  // A ball of radius r seen from afar: mean squared distance from the axis is 2/5 r^2.
  EXPECT_NEAR(miss, 0.4 * 0.04, 0.002);
}

TEST(PoseSamplerTest, StaysAroundFixedPlacements) {
  PoseConfig config;
  config.rho_cm = {180, 200};
  config.height_cm = {10, 40};
  config.phi_deg = {45, 135, 225, 315};
  config.phi_jitter_deg = 10;
  constexpr int kCount = 4000;
  std::array<int, 4> placements{};
  std::array<int, 4> quarters{};  // of the deviation's range
  for (std::uint64_t i = 0; i < kCount; ++i) {
    RandomStream random(13, i, "pose");
    const Eigen::Vector3d t = SamplePose(config, random).translation();
    const double rho = std::hypot(t.x(), t.z());
    EXPECT_GE(rho, 1.80 - 1e-9);
    EXPECT_LE(rho, 2.00 + 1e-9);
    EXPECT_GE(t.y(), 0.10 - 1e-9);
    EXPECT_LE(t.y(), 0.40 + 1e-9);
    const double phi = std::fmod(std::atan2(t.z(), t.x()) / kDegree + 360, 360);
    const double off = phi - (90 * std::floor(phi / 90) + 45);
    ASSERT_LE(std::abs(off), 10 + 1e-9);
    ++placements[static_cast<std::size_t>(phi / 90)];
    ++quarters[std::min<std::size_t>(static_cast<std::size_t>((off + 10) / 5), 3)];
  }
  const double quarter = kCount / 4.0;
  for (const int count : placements) EXPECT_NEAR(count, quarter, 5 * std::sqrt(quarter));
  for (const int count : quarters) EXPECT_NEAR(count, quarter, 5 * std::sqrt(quarter));
}

TEST(PoseSamplerTest, NeedsAMountingRoll) {
  PoseConfig config;
  config.roll_offsets_deg.clear();
  RandomStream random(1, 1, "pose");
  EXPECT_THROW(SamplePose(config, random), ConfigError);
}

std::shared_ptr<SampleContext> SmallContext(int batch_size) {
  SampleConfig config;
  config.image_sizes = {"80x72", "80x45"};
  return std::make_shared<SampleContext>(MakeSampleContext(config, batch_size));
}

StreamOptions Threads(int num_threads, std::uint64_t first_index) {
  return {21, first_index, num_threads, GlRenderers(), {}, nullptr, /*prefetch=*/2};
}

TEST(StreamSamples, GivesTheSameSamplesInOrderWithAnyNumberOfThreads) {
  const auto context = SmallContext(4);
  const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
  DepthRenderer& renderer = *owned;
  for (const int num_threads : {1, 3}) {
    const auto draw = StreamSamples(context, Threads(num_threads, 8));
    for (std::uint64_t index = 8; index < 32; ++index) {
      const Sample sample = draw();
      EXPECT_EQ(sample.index, index);
      ExpectEqual(sample, Synthesize(*context, renderer, 21, index));
    }
  }
}

TEST(StreamSamples, SlicesAreTheBatchesTakenApart) {
  const auto context = SmallContext(4);
  const auto whole = StreamSamples(context, Threads(1, 8));
  StreamOptions first = Threads(1, 8), second = Threads(2, 8);
  first.slice = {0, 1};
  second.slice = {1, 3};
  const auto one = StreamSamples(context, first), three = StreamSamples(context, second);
  for (int i = 0; i < 12; ++i) ExpectEqual(i % 4 == 0 ? one() : three(), whole());
  first.slice = {2, 3};
  EXPECT_THROW(StreamSamples(context, first), Error);
  EXPECT_THROW(StreamSamples(context, Threads(1, 2)), Error);
}

}  // namespace
}  // namespace volalign::sample_test
