// How long a network's segmenter takes a frame, and which labels it gives: for
// tests/bench/deployment.py.
//
//   segment_time FILE ROUNDS WIDTHxHEIGHT.f32...
//
// FILE is a checkpoint, or ends with .onnx. Each other file has depth maps of that size, float32,
// metres, one after the other, as the network sees them. Beside it FILE.labels is written, a byte a
// pixel. Printed: the least ms a frame over the rounds, each of all frames one by one, on two
// threads.

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/nn/cpu/torch_threads.h"
#include "infer/segment/load.h"
#include "infer/segment_onnx/load.h"
#include "tests/bench/program.h"

namespace volalign {
namespace {

constexpr int kThreads = 2;
/// px: within the range of all shipped networks, so that frames go through as they are.
constexpr double kFocal = 120;

struct Frame {
  std::string file;
  DepthImage depth;
};

std::vector<Frame> ReadFrames(const std::string& file) {
  int width = 0, height = 0;
  const std::string name = std::filesystem::path(file).filename().string();
  if (std::sscanf(name.c_str(), "%dx%d", &width, &height) != 2) throw Error(file + ": no size");
  std::ifstream stream(file, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(stream)),
                          std::istreambuf_iterator<char>());
  std::vector<Frame> frames;
  const std::size_t size = static_cast<std::size_t>(width * height) * sizeof(float);
  for (std::size_t at = 0; at + size <= bytes.size(); at += size) {
    frames.push_back({file, DepthImage(width, height)});
    std::copy_n(bytes.data() + at, size, reinterpret_cast<char*>(frames.back().depth.data()));
  }
  return frames;
}

void Measure(const std::string& model, int rounds, const std::vector<std::string>& files) {
  SetTorchThreads(kThreads);
  cv::setNumThreads(kThreads);
  const std::unique_ptr<NetworkSegmenter> segmenter =
      std::filesystem::path(model).extension() == ".onnx" ? LoadOnnxSegmenter(model)
                                                          : LoadNetworkSegmenter(model);
  std::vector<Frame> frames;
  for (const std::string& file : files) {
    for (Frame& frame : ReadFrames(file)) frames.push_back(std::move(frame));
  }
  double least_ms = std::numeric_limits<double>::infinity();
  for (int round = 0; round <= rounds; ++round) {  // the first one makes what is kept
    const auto start = std::chrono::steady_clock::now();
    std::vector<SegmentationResult> results;
    for (const Frame& frame : frames) {
      Intrinsics intrinsics;
      intrinsics.width = frame.depth.width();
      intrinsics.height = frame.depth.height();
      intrinsics.fx = intrinsics.fy = kFocal;
      results.push_back(segmenter->Segment(frame.depth, intrinsics, 0));
    }
    const std::chrono::duration<double, std::milli> taken =
        std::chrono::steady_clock::now() - start;
    if (round > 0)
      least_ms = std::min(least_ms, taken.count() / static_cast<double>(frames.size()));
    for (const std::string& file : files) std::filesystem::remove(file + ".labels");
    for (std::size_t i = 0; i < frames.size(); ++i) {
      std::ofstream(frames[i].file + ".labels", std::ios::binary | std::ios::app)
          .write(reinterpret_cast<const char*>(results[i].labels.data()),
                 static_cast<std::streamsize>(results[i].labels.size()));
    }
  }
  fmt::print("{:.2f}\n", least_ms);
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  if (argc < 4) {
    fmt::print(stderr, "segment_time FILE ROUNDS WIDTHxHEIGHT.f32...\n");
    return 2;
  }
  return volalign::StatusOf([&] {
    volalign::Measure(argv[1], std::atoi(argv[2]), {argv + 3, argv + argc});
    return 0;
  });
}
