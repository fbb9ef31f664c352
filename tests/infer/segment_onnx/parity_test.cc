// Do the shipped networks give as ONNX what LibTorch gives? By other runtimes:
// tests/core/nn/export_onnx_test.cc.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "core/nn/export_onnx.h"
#include "infer/segment/load.h"
#include "infer/segment_onnx/load.h"
#include "render/sample.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::parity_test {
namespace {

namespace fs = std::filesystem;

/// Rendered frames of both shapes of training, and one of 161x143.
std::vector<DepthImage> RenderedFrames() {
  SampleConfig config;
  config.image_sizes = {"160x144", "160x90"};
  const SampleContext context = MakeSampleContext(config, 2);
  TileRenderer renderer;
  std::vector<DepthImage> frames;
  for (std::uint64_t i = 0; i < 8; ++i) frames.push_back(Synthesize(context, renderer, 1, i).depth);
  DepthImage odd(161, 143);
  const DepthImage& frame = *std::find_if(frames.begin(), frames.end(),
                                          [](const DepthImage& f) { return f.height() == 144; });
  for (const auto [u, v] : Pixels(odd)) odd(u, v) = frame(std::min(u, 159), v);
  frames.push_back(odd);
  return frames;
}

/// Share of the frames' pixels with depth that LoadOnnxSegmenter labels as LibTorch does, of the
/// frames as they are and turned.
double AgreementOf(const fs::path& checkpoint, const std::vector<DepthImage>& frames) {
  const TempFolder folder;
  const fs::path onnx = folder / (checkpoint.stem().string() + ".fp16.onnx");
  ExportOnnx(checkpoint, onnx, /*half=*/true);
  const auto theirs = LoadNetworkSegmenter(checkpoint);
  const auto ours = LoadOnnxSegmenter(onnx);
  std::vector<Intrinsics> intrinsics;
  std::vector<SegmentationRequest> requests;
  intrinsics.reserve(frames.size());
  for (const DepthImage& frame : frames) {
    // Within the trained range of focal lengths: as they are.
    intrinsics.push_back({frame.width(), frame.height(), 120, 120, 0, 0, {}});
    for (const int turn : {0, 1}) requests.push_back({&frame, &intrinsics.back(), turn});
  }
  const std::vector<SegmentationResult> expected = theirs->Segment(requests);
  const std::vector<SegmentationResult> found = ours->Segment(requests);
  double pixels = 0, same = 0;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const DepthImage& depth = *requests[i].depth;
    for (std::size_t j = 0; j < depth.size(); ++j) {
      if (!(depth[j] > 0)) continue;
      ++pixels;
      same += expected[i].labels[j] == found[i].labels[j] ? 1 : 0;
    }
  }
  return same / pixels;
}

// Of the network that calibration uses, and one without attention; with VOLALIGN_LONG=1 also those
// of the same layers.
TEST(Parity, OnRenderedFrames) {
  std::vector<fs::path> checkpoints = {"models/m05-lite.safetensors"};
  for (const fs::directory_entry& entry : fs::directory_iterator("models/paper-lite")) {
    const fs::path& file = entry.path();
    if (file.extension() == ".safetensors" && (file.stem() == "m01" || Rounds(0, 1) == 1))
      checkpoints.push_back(file);
  }
  ASSERT_GT(checkpoints.size(), 1u);
  const std::vector<DepthImage> frames = RenderedFrames();
  for (const fs::path& checkpoint : checkpoints)
    EXPECT_GE(AgreementOf(checkpoint, frames), 0.9999) << checkpoint;
}

}  // namespace
}  // namespace volalign::parity_test
