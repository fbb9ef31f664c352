// Do all formats of all shipped networks give what LibTorch gives, on frames as they occur? ONNX
// Runtime and Python's torch run the files (tests/core/nn/export_onnx_check.py).

#include <ATen/ops/cat.h>
#include <ATen/ops/from_blob.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/nn/checkpoint.h"
#include "core/nn/export_onnx.h"
#include "core/nn/export_torchscript.h"
#include "infer/formats/depth_file.h"
#include "infer/segment/load.h"
#include "infer/segment_onnx/load.h"
#include "render/sample.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/nn/run_check.h"

namespace volalign::parity_test {
namespace {

namespace fs = std::filesystem;

/// The real frames have no licence to be shipped: a folder of their own, or none.
fs::path CapturesFolder() {
  const char* folder = std::getenv("VOLALIGN_CAPTURES");
  return folder && *folder ? folder : "../shared/captures";
}

/// Every n-th pixel of every n-th row, so that the width is at most that of training.
DepthImage Thinned(const DepthImage& depth) {
  const int n = (std::max(depth.width(), depth.height()) + 199) / 200;
  DepthImage thin(depth.width() / n, depth.height() / n);
  for (const auto [u, v] : Pixels(thin)) thin(u, v) = depth(n * u, n * v);
  return thin;
}

DepthImage Read(const fs::path& file) {
  DepthImage depth = ReadStoredDepth(file).values;
  for (float& z : depth) z *= 0.001f;  // all of them are in millimetres
  return Thinned(depth);
}

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

/// The real frames, and of those of another simulator's rigs every n-th.
std::vector<DepthImage> CapturedFrames(std::size_t n) {
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(CapturesFolder())) {
    if (entry.path().extension() == ".pgm") files.push_back(entry.path());
  }
  if (fs::exists(CapturesFolder() / "foreign")) {
    for (const auto& entry : fs::recursive_directory_iterator(CapturesFolder() / "foreign")) {
      if (entry.path().extension() == ".png") files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  std::vector<DepthImage> frames;
  std::size_t foreign = 0;
  for (const fs::path& file : files) {
    if (file.extension() == ".pgm" || foreign++ % n == 0) frames.push_back(Read(file));
  }
  return frames;
}

/// [B,1,H,W] each, of up to eight frames of one size.
std::vector<at::Tensor> Batches(const std::vector<DepthImage>& frames) {
  std::map<std::pair<int, int>, std::vector<at::Tensor>> by_size;
  for (const DepthImage& frame : frames) {
    by_size[{frame.width(), frame.height()}].push_back(
        at::from_blob(const_cast<float*>(frame.data()), {1, 1, frame.height(), frame.width()},
                      at::kFloat)
            .clone());
  }
  std::vector<at::Tensor> batches;
  for (const auto& [size, all] : by_size) {
    for (std::size_t begin = 0; begin < all.size(); begin += 8) {
      const auto end = static_cast<std::ptrdiff_t>(std::min(begin + 8, all.size()));
      batches.push_back(at::cat(std::vector<at::Tensor>(
          all.begin() + static_cast<std::ptrdiff_t>(begin), all.begin() + end)));
    }
  }
  return batches;
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

void ExpectAgreementOfOtherRuntimes(const fs::path& checkpoint,
                                    const std::vector<DepthImage>& frames) {
  const TempFolder folder;
  const std::string name = checkpoint.stem().string();
  for (const bool half : {false, true}) {
    const std::string precision = half ? ".fp16" : ".fp32";
    ExportOnnx(checkpoint, folder / (name + precision + ".onnx"), half);
    ExportTorchScript(checkpoint, folder / (name + precision + ".ts"), half);
  }
  const c10::NoGradGuard no_grad;
  LoadedModel model = LoadCheckpoint(checkpoint);
  const std::vector<at::Tensor> batches = Batches(BothWays(frames));
  for (std::size_t i = 0; i < batches.size(); ++i) {
    testing_nn::WriteValues(folder.path(), fmt::format("depth{}", i), batches[i]);
    testing_nn::WriteValues(folder.path(), fmt::format("{}.expected{}", name, i),
                            model.net->forward(EncodeDepth(batches[i], model.meta.network.input)));
  }
  EXPECT_EQ(
      testing_nn::RunCheck(VOLALIGN_PYTHON, "tests/core/nn/export_onnx_check.py", folder.path()), 0)
      << name;
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

/// All of them for the network that calibration uses; the others are of the same layers.
std::vector<DepthImage> CapturedFramesFor(const std::string& checkpoint) {
  return CapturedFrames(checkpoint == "models/m05-lite.safetensors" ? 1 : 8);
}

std::string NameOf(const testing::TestParamInfo<std::string>& shipped) {
  std::string name = fs::path(shipped.param).stem().string();
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

class Parity : public testing::TestWithParam<std::string> {};

TEST_P(Parity, OnRenderedFrames) { ExpectAgreement(GetParam(), RenderedFrames()); }
TEST_P(Parity, OnCapturedFrames) { ExpectAgreement(GetParam(), CapturedFramesFor(GetParam())); }

INSTANTIATE_TEST_SUITE_P(Shipped, Parity, testing::ValuesIn(ShippedCheckpoints()), NameOf);

class OtherRuntimes : public testing::TestWithParam<std::string> {};

TEST_P(OtherRuntimes, OnRenderedFrames) {
  ExpectAgreementOfOtherRuntimes(GetParam(), RenderedFrames());
}
TEST_P(OtherRuntimes, OnCapturedFrames) {
  ExpectAgreementOfOtherRuntimes(GetParam(), CapturedFramesFor(GetParam()));
}

INSTANTIATE_TEST_SUITE_P(Shipped, OtherRuntimes, testing::ValuesIn(ShippedCheckpoints()), NameOf);

}  // namespace
}  // namespace volalign::parity_test
