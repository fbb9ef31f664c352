#include <benchmark/benchmark.h>

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include "render/egl/egl_context.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "render/sample_stream.h"

namespace volalign {
namespace {

constexpr std::uint64_t kSeed = 1;
constexpr std::uint64_t kDistinct = 256;  // samples that a benchmark goes round

/// Complete samples of the default configuration (rooms, sensor models, imprecise assembly);
/// argument 0 to 3 chooses sensor and size.
const char* const kSizes[] = {"320x180", "160x90", "320x288", "160x144"};
const char* const kSensors[] = {"realsense_d415", "realsense_d415", "azure_kinect_nfov_binned",
                                "azure_kinect_nfov_binned"};

/// The renderers, by the last argument of a benchmark.
const char* const kRenderers[] = {"egl", "cpu"};

SampleContext MakeContext(std::int64_t size, int batch_size) {
  SampleConfig config;
  config.sensors = {kSensors[size]};
  config.image_sizes = {kSizes[size]};
  return MakeSampleContext(config, batch_size);
}

/// Whole samples of one thread.
void BM_Synthesize(benchmark::State& state) {
  const Renderers chosen = ChooseRenderers(kRenderers[state.range(1)]);
  const std::unique_ptr<DepthRenderer> renderer = chosen.make();
  const SampleContext context = MakeContext(state.range(0), 1);
  std::uint64_t index = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        Synthesize(context, *renderer, kSeed, index++ % kDistinct).depth.data());
  }
  state.SetItemsProcessed(state.iterations());
  state.SetLabel(std::string(kSizes[state.range(0)]) + ", " + chosen.name);
}
BENCHMARK(BM_Synthesize)->ArgsProduct({{0, 1, 2, 3}, {0, 1}})->Unit(benchmark::kMicrosecond);

/// Whole samples through the stream, arguments: size, worker threads, renderer.
void BM_SampleStream(benchmark::State& state) {
  constexpr int kBatch = 16;
  SampleStream::Options options;
  options.seed = kSeed;
  options.num_threads = static_cast<int>(state.range(1));
  options.make_renderer = ChooseRenderers(kRenderers[state.range(2)]).make;
  SampleStream stream(std::make_shared<const SampleContext>(MakeContext(state.range(0), kBatch)),
                      options);
  for (auto _ : state) benchmark::DoNotOptimize(stream.Next().data());
  state.SetItemsProcessed(state.iterations() * kBatch);
  state.SetLabel(std::string(kSizes[state.range(0)]) + ", " + std::to_string(state.range(1)) +
                 " threads, " + kRenderers[state.range(2)]);
}
BENCHMARK(BM_SampleStream)
    ->ArgsProduct({{0, 1, 2, 3}, {1, 2}, {0, 1}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  volalign::KeepSoftwareRenderingOnOneThread();
#if defined(__GLIBC__)
  // As `train` and `render` do (KeepFreedMemory): otherwise images come from new pages each time.
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
