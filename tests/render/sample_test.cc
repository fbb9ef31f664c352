#include "render/sample.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <utility>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/has.h"
#include "tests/core/base/pixels.h"
#include "tests/render/test_scene.h"

namespace volalign::sample_test {
namespace {

void ExpectEqual(const Sample& a, const Sample& b) {
  EXPECT_EQ(a.index, b.index);
  EXPECT_EQ(a.sensor, b.sensor);
  EXPECT_TRUE(a.intrinsics == b.intrinsics);
  EXPECT_EQ(a.structure_from_sensor.matrix(), b.structure_from_sensor.matrix());
  EXPECT_TRUE(a.depth == b.depth);
  EXPECT_TRUE(a.labels == b.labels);
  EXPECT_TRUE(a.depth_clean == b.depth_clean);
  EXPECT_TRUE(a.labels_clean == b.labels_clean);
  ASSERT_EQ(a.box_offsets.size(), b.box_offsets.size());
  for (std::size_t i = 0; i < a.box_offsets.size(); ++i) {
    EXPECT_EQ(a.box_offsets[i].matrix(), b.box_offsets[i].matrix());
  }
}

SampleConfig SmallConfig() {
  SampleConfig config;
  config.image_sizes = {"160x144", "160x90"};
  return config;
}

class SampleTest : public testing::Test {
 protected:
  EglContext egl_;
  GlDepthRenderer renderer_;
};

TEST_F(SampleTest, IsAPureFunctionWhateverTheOrderAndThread) {
  const SampleContext context = MakeSampleContext(SmallConfig(), 2);
  std::map<std::uint64_t, Sample> first;
  for (const std::uint64_t i : {0, 1, 2, 3, 4, 5, 6, 7}) {
    first[i] = Synthesize(context, renderer_, 9, i);
  }
  for (const std::uint64_t i : {7, 2, 5, 0}) {
    ExpectEqual(first[i], Synthesize(context, renderer_, 9, i));
  }
  std::thread([&] {
    const EglContext egl;
    GlDepthRenderer renderer;
    for (const std::uint64_t i : {3, 6, 1}) {
      ExpectEqual(first[i], Synthesize(context, renderer, 9, i));
    }
  }).join();
  EXPECT_FALSE(first[0].depth == Synthesize(context, renderer_, 10, 0).depth);
}

TEST_F(SampleTest, SwitchingNoiseOffLeavesEverythingElse) {
  SampleConfig config = SmallConfig();
  const SampleContext sensor = MakeSampleContext(config, 4);
  config.noise.models = {"none"};
  const SampleContext none = MakeSampleContext(config, 4);
  config.noise.models = {"paper"};
  const SampleContext paper = MakeSampleContext(config, 4);
  for (std::uint64_t i = 0; i < 6; ++i) {
    const Sample a = Synthesize(sensor, renderer_, 2, i);
    const Sample b = Synthesize(none, renderer_, 2, i);
    const Sample c = Synthesize(paper, renderer_, 2, i);
    for (const Sample* other : {&b, &c}) {
      EXPECT_EQ(a.structure_from_sensor.matrix(), other->structure_from_sensor.matrix());
      EXPECT_TRUE(a.intrinsics == other->intrinsics);
      EXPECT_TRUE(a.depth_clean == other->depth_clean);
      EXPECT_TRUE(a.labels_clean == other->labels_clean);
    }
    EXPECT_TRUE(b.depth == b.depth_clean);
    EXPECT_TRUE(b.labels == b.labels_clean);
    EXPECT_FALSE(a.depth == a.depth_clean);
  }
  config.noise.models = {"paper", "physics"};
  ExpectError<ConfigError>([&] { MakeSampleContext(config, 4); }, {"physics", "first"});
}

TEST_F(SampleTest, SwitchingClutterOffLeavesPoseAndAssembly) {
  SampleConfig config = SmallConfig();
  const SampleContext full = MakeSampleContext(config, 4);
  config.scene = BareConfig().scene;
  const SampleContext bare = MakeSampleContext(config, 4);
  for (std::uint64_t i = 0; i < 4; ++i) {
    const Sample a = Synthesize(full, renderer_, 2, i);
    const Sample b = Synthesize(bare, renderer_, 2, i);
    EXPECT_EQ(a.structure_from_sensor.matrix(), b.structure_from_sensor.matrix());
    EXPECT_EQ(a.box_offsets[0].matrix(), b.box_offsets[0].matrix());
    EXPECT_EQ(a.size_scale, b.size_scale);
  }
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

TEST_F(SampleTest, SamplesWithoutTheStructureAreBackground) {
  SampleConfig config = SmallConfig();
  config.scene.structure_probability = 0;
  const SampleContext context = MakeSampleContext(config, 4);
  const Sample sample = Synthesize(context, renderer_, 5, 0);
  EXPECT_EQ(std::count(sample.labels.begin(), sample.labels.end(), 0),
            static_cast<long>(sample.labels.size()));
  EXPECT_GT(std::count_if(sample.depth_clean.begin(), sample.depth_clean.end(),
                          [](float z) { return z > 0; }),
            static_cast<long>(sample.labels.size() / 2));
}

TEST(SampleContextTest, NamesWhatIsWrong) {
  const auto message = [](const SampleConfig& config) {
    try {
      MakeSampleContext(config, 4);
    } catch (const ConfigError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  SampleConfig config;
  config.sensors = {"kinect_v9"};
  EXPECT_TRUE(Has(message(config), "kinect_v9"));
  config = SampleConfig();
  config.image_sizes = {"160x160"};
  EXPECT_TRUE(Has(message(config), "160x160"));
  // Each size has a sensor, but a sensor that is named has no size.
  config.image_sizes = {"160x144", "80x72"};
  for (const char* part : {"realsense_d415 (1280x720, 640x480)", "[160x144, 80x72]"}) {
    EXPECT_TRUE(Has(message(config), part));
  }
  config.image_sizes = {"big"};
  EXPECT_TRUE(Has(message(config), "big"));
  config = SampleConfig();
  config.pose.rho_cm = {200, 100};
  EXPECT_EQ(message(config).rfind("data.pose.rho_cm = [200, 100]", 0), 0U) << message(config);
  config = SampleConfig();
  config.pose.phi_jitter_deg = 10;
  EXPECT_TRUE(Has(message(config), "phi_deg"));
  config = SampleConfig();
  EXPECT_EQ(message(config), "");
  EXPECT_THROW(MakeSampleContext(config, 0), ConfigError);
}

}  // namespace
}  // namespace volalign::sample_test
