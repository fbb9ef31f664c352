// Draws many samples through a SampleStream and prints the resident memory as it goes:
//   render_soak [SAMPLES [WIDTHxHEIGHT [THREADS]]]

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <string>

#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "render/sample_stream.h"

namespace {

double ResidentMegabytes() {
  std::ifstream statm("/proc/self/statm");
  long total = 0, resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

}  // namespace

int main(int argc, char** argv) {
  volalign::KeepSoftwareRenderingOnOneThread();
  constexpr int kBatch = 16;
  const long samples = argc > 1 ? std::stol(argv[1]) : 1000000;
  volalign::SampleConfig config;
  config.sensors = {};
  config.image_sizes = {argc > 2 ? argv[2] : "64x36"};
  volalign::SampleStream::Options options;
  options.make_renderer = volalign::GlRenderers();
  options.num_threads = argc > 3 ? std::stoi(argv[3]) : 2;
  volalign::SampleStream stream(
      std::make_shared<const volalign::SampleContext>(volalign::MakeSampleContext(config, kBatch)),
      options);
  const auto start = std::chrono::steady_clock::now();
  const long step = std::max<long>(samples / 20, kBatch);
  long next = 0;
  for (long drawn = 0; drawn < samples; drawn += kBatch) {
    stream.Next();
    if (drawn < next) continue;
    next += step;
    const double s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    fmt::print("{:>9} samples  {:7.1f} s  {:7.1f} MB resident\n", drawn + kBatch, s,
               ResidentMegabytes());
    std::fflush(stdout);
  }
  return 0;
}
