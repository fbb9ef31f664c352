#include "render/sample_stream.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"

namespace volalign::sample_stream_test {
namespace {

std::shared_ptr<SampleContext> SmallContext(int batch_size) {
  SampleConfig config;
  config.image_sizes = {"80x72", "80x45"};
  return std::make_shared<SampleContext>(MakeSampleContext(config, batch_size));
}

SampleStream::Options Threads(int num_threads, std::uint64_t first_index) {
  SampleStream::Options options;
  options.seed = 21;
  options.first_index = first_index;
  options.num_threads = num_threads;
  options.prefetch = 2;
  options.make_renderer = GlRenderers();
  return options;
}

TEST(SampleStreamTest, GivesTheSameBatchesInOrderWithAnyNumberOfThreads) {
  const auto context = SmallContext(4);
  const EglContext egl;
  GlDepthRenderer renderer;
  for (const int num_threads : {1, 3}) {
    SampleStream stream(context, Threads(num_threads, 8));
    std::uint64_t index = 8;
    for (int batch = 0; batch < 6; ++batch) {
      std::vector<Sample> samples;
      if (batch % 2 == 0) {
        samples = stream.Next();
      } else {
        for (int i = 0; i < 4; ++i) samples.push_back(stream.NextSample());
      }
      ASSERT_EQ(samples.size(), 4u);
      for (const Sample& sample : samples) {
        const Sample alone = Synthesize(*context, renderer, 21, index);
        EXPECT_EQ(sample.index, index);
        EXPECT_TRUE(sample.depth == alone.depth);
        EXPECT_TRUE(sample.labels == alone.labels);
        EXPECT_EQ(sample.structure_from_sensor.matrix(), alone.structure_from_sensor.matrix());
        ++index;
      }
    }
  }
}

TEST(SampleStreamTest, SlicesAreTheBatchesTakenApart) {
  const auto context = SmallContext(4);
  SampleStream whole(context, Threads(1, 8));
  SampleStream::Options first = Threads(1, 8), second = Threads(2, 8);
  first.slice = {0, 1};
  second.slice = {1, 3};
  SampleStream one(context, first), three(context, second);
  for (int batch = 0; batch < 3; ++batch) {
    const std::vector<Sample> samples = whole.Next();
    std::vector<Sample> parts = one.Next();
    for (Sample& sample : three.Next()) parts.push_back(std::move(sample));
    ASSERT_EQ(parts.size(), samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      EXPECT_EQ(parts[i].index, samples[i].index);
      EXPECT_TRUE(parts[i].depth == samples[i].depth);
    }
  }
  first.slice = {2, 3};
  EXPECT_THROW(SampleStream(context, first), Error);
}

TEST(SampleStreamTest, AWorkersExceptionReachesTheCaller) {
  const auto context = SmallContext(4);
  for (IntrinsicsPoolEntry& entry : context->pool) entry.sensor = "unknown_sensor";
  SampleStream stream(context, Threads(2, 0));
  EXPECT_THROW(stream.Next(), ConfigError);
  EXPECT_THROW(stream.Next(), ConfigError);
}

TEST(SampleStreamTest, StopsWithinABatch) {
  SampleConfig config;
  config.sensors = {"azure_kinect_nfov_binned"};
  config.image_sizes = {"320x288"};
  constexpr int kBatch = 20000;  // drawn in a minute or more
  const auto context = std::make_shared<SampleContext>(MakeSampleContext(config, kBatch));
  SampleStream::Options options = Threads(2, 0);
  options.begun = std::make_shared<std::atomic<std::uint64_t>>(0);
  {
    const SampleStream stream(context, options);
    while (*options.begun < 4) std::this_thread::yield();
  }
  EXPECT_LT(*options.begun, kBatch / 2);
}

TEST(SampleStreamTest, RejectsBadOptions) {
  const auto context = SmallContext(4);
  EXPECT_THROW(SampleStream(context, Threads(1, 2)), Error);
  EXPECT_THROW(SampleStream(context, Threads(0, 0)), Error);
  SampleStream::Options options = Threads(1, 0);
  options.prefetch = 0;
  EXPECT_THROW(SampleStream(context, options), Error);
}

}  // namespace
}  // namespace volalign::sample_stream_test
