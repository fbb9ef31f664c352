// Do the shipped networks give as ONNX what LibTorch gives? By other runtimes:
// tests/core/nn/export_onnx_test.cc.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
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

/// Share of pixels with depth that LoadOnnxSegmenter labels as LibTorch does.
double AgreementOf(const fs::path& checkpoint, const fs::path& onnx,
                   const std::vector<DepthImage>& frames) {
  const auto theirs = LoadNetworkSegmenter(checkpoint);
  const auto ours = LoadOnnxSegmenter(onnx);
  std::vector<Intrinsics> intrinsics(frames.size());
  std::vector<SegmentationRequest> requests;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    intrinsics[i].width = frames[i].width();
    intrinsics[i].height = frames[i].height();
    intrinsics[i].fx = intrinsics[i].fy = 120;  // within the trained range: as they are
    requests.push_back({&frames[i], &intrinsics[i], 0});
  }
  const std::vector<SegmentationResult> expected = theirs->Segment(requests);
  const std::vector<SegmentationResult> found = ours->Segment(requests);
  double pixels = 0, same = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    for (std::size_t j = 0; j < frames[i].size(); ++j) {
      if (!(frames[i][j] > 0)) continue;
      ++pixels;
      same += expected[i].labels[j] == found[i].labels[j] ? 1 : 0;
    }
  }
  const double agreement = same / pixels;
  std::cout << fmt::format("{}, {}: {:.4f} % labels equal\n", checkpoint.stem().string(),
                           ours->runtime(), 100 * agreement)
            << std::flush;
  return agreement;
}

/// The frames, and these once more, turned.
std::vector<DepthImage> BothWays(std::vector<DepthImage> frames) {
  const std::size_t count = frames.size();
  for (std::size_t i = 0; i < count; ++i) frames.push_back(Turn(frames[i], 1));
  return frames;
}

void ExpectAgreement(const fs::path& checkpoint, const std::vector<DepthImage>& frames) {
  const TempFolder folder;
  const std::string name = checkpoint.stem().string();
  const fs::path onnx = folder / (name + ".fp16.onnx");
  ExportOnnx(checkpoint, onnx, /*half=*/true);
  EXPECT_TRUE(AgreementOf(checkpoint, onnx, BothWays(frames)) >= 0.9999) << name;
}

/// The network that calibration uses, and one without attention; with VOLALIGN_LONG=1 also those of
/// the same layers.
std::vector<std::string> ShippedCheckpoints() {
  if (Rounds(0, 1) == 0)
    return {"models/m05-lite.safetensors", "models/paper-lite/m01.safetensors"};
  std::vector<std::string> files = {"models/m05-lite.safetensors"};
  for (const fs::directory_entry& entry : fs::directory_iterator("models/paper-lite")) {
    if (entry.path().extension() == ".safetensors") files.push_back(entry.path().string());
  }
  return files;
}

std::string NameOf(const testing::TestParamInfo<std::string>& shipped) {
  std::string name = fs::path(shipped.param).stem().string();
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

class Parity : public testing::TestWithParam<std::string> {};

TEST_P(Parity, OnRenderedFrames) { ExpectAgreement(GetParam(), RenderedFrames()); }

INSTANTIATE_TEST_SUITE_P(Shipped, Parity, testing::ValuesIn(ShippedCheckpoints()), NameOf);

}  // namespace
}  // namespace volalign::parity_test
