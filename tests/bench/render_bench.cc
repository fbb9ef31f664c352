#include <benchmark/benchmark.h>

#include <vector>

#include "render/depth_renderer.h"
#include "render/egl_context.h"
#include "render/pose_sampler.h"
#include "render/sample.h"
#include "render/scene.h"

namespace volalign {
namespace {

/// Frames a second of one thread for full rooms, 320x180, vertices included.
void BM_RenderRoom(benchmark::State& state) {
  const EglContext egl;
  DepthRenderer renderer;
  SampleConfig config;
  config.image_sizes = {"320x180"};
  const SampleContext context = MakeSampleContext(config, 1);
  const Intrinsics intrinsics = context.pool[0].intrinsics[0].Resized(320, 180);
  std::vector<SceneMesh> meshes;
  std::vector<Pose> poses;
  for (std::uint64_t i = 0; i < 64; ++i) {
    RandomStream random(1, i, "pose");
    poses.push_back(SamplePose(config.pose, random));
    SceneOptions options;
    options.structure_from_sensors = {poses.back()};
    meshes.push_back(BuildScene(config.scene, context.structure, options, 1, i));
  }
  RenderedView view;
  std::size_t i = 0;
  for (auto _ : state) {
    renderer.Render(meshes[i % 64], intrinsics, poses[i % 64], &view);
    benchmark::DoNotOptimize(view.depth.data());
    ++i;
  }
  state.SetItemsProcessed(state.iterations());
  state.SetLabel(egl.Describe());
}
BENCHMARK(BM_RenderRoom)->Unit(benchmark::kMillisecond);

/// Whole samples of one thread; argument 0: D415 at 160x90, 1: Azure Kinect at 160x144, 2: Azure
/// Kinect at 320x288.
void BM_Synthesize(benchmark::State& state) {
  const EglContext egl;
  DepthRenderer renderer;
  SampleConfig config;
  const char* const sizes[] = {"160x90", "160x144", "320x288"};
  config.image_sizes = {sizes[state.range(0)]};
  const SampleContext context = MakeSampleContext(config, 1);
  std::uint64_t index = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(Synthesize(context, renderer, 1, index++ % 256).depth.data());
  }
  state.SetItemsProcessed(state.iterations());
  state.SetLabel(sizes[state.range(0)]);
}
BENCHMARK(BM_Synthesize)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace volalign

BENCHMARK_MAIN();
