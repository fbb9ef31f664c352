// What it costs to put samples into a batch's slots, beside what they cost to draw: processor time
// of one thread, each the least of several rounds.
//   pack_time [ROUNDS]

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <vector>

#include "render/sample.h"
#include "render/tiles/tile_renderer.h"
#include "tests/bench/program.h"
#include "train/batch.h"
#include "train/compute.h"

namespace volalign {
namespace {

constexpr int kBatch = 16;

void Measure(const char* sensor, const char* size, int rounds) {
  SampleConfig config;
  config.sensors = {sensor};
  config.image_sizes = {size};
  const SampleContext context = MakeSampleContext(config, kBatch);
  TileRenderer renderer;
  BatchPacker packer(at::kCPU);
  double drawing = 1e9, packing = 1e9;
  for (int round = 0; round < rounds; ++round) {
    const double start = ThreadSeconds();
    std::vector<Sample> samples;
    for (int i = 0; i < kBatch; ++i)
      samples.push_back(Synthesize(context, renderer, 1, static_cast<std::uint64_t>(i)));
    const double drawn = ThreadSeconds();
    packer.Pack(samples);
    drawing = std::min(drawing, drawn - start);
    packing = std::min(packing, ThreadSeconds() - drawn);
  }
  fmt::print("| {}, {} | {:.3f} | {:.3f} | {:.1f} % |\n", sensor, size, 1e3 * drawing / kBatch,
             1e3 * packing / kBatch, 100 * packing / drawing);
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  volalign::KeepFreedMemory();
  const int rounds = argc > 1 ? std::atoi(argv[1]) : 20;
  fmt::print("| sample | drawing, ms | packing, ms | share |\n|---|---|---|---|\n");
  volalign::Measure("realsense_d415", "320x180", rounds);
  volalign::Measure("azure_kinect_nfov_binned", "320x288", rounds);
}
