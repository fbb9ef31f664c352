#include "infer/segment/load.h"

#include <ATen/ops/cat.h>
#include <ATen/ops/from_blob.h>
#include <c10/core/GradMode.h>

#include <algorithm>
#include <map>
#include <utility>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/nn/checkpoint.h"
#include "core/nn/network.h"
#include "core/nn/torch_device.h"
#include "infer/view/network_frame.h"

namespace volalign {

namespace {

/// Frames that go through the network together at most: bounds the memory of a pass.
constexpr std::size_t kBatch = 8;

class TorchSegmenter : public NetworkSegmenter {
 public:
  TorchSegmenter(const std::filesystem::path& checkpoint, const Structure* structure,
                 const at::Device& device)
      : device_(device),
        model_(LoadCheckpoint(checkpoint)),
        file_(checkpoint.string()),
        sha256_(Sha256(ReadFile(FindInputFile(checkpoint.string()), kMaxModelBytes))) {
    if (structure) CheckStructure(model_.meta, *structure);
    model_.net->to(device_);
    // With channels last, a forward pass on two cores takes two thirds of the time.
    for (at::Tensor& weight : model_.net->parameters()) {
      if (weight.dim() == 4) weight.set_data(weight.contiguous(at::MemoryFormat::ChannelsLast));
    }
  }

  using NetworkSegmenter::Segment;
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override;

  const Structure& structure() const override { return model_.meta.structure; }
  const std::string& file() const override { return file_; }
  const std::string& sha256() const override { return sha256_; }

 private:
  struct Prepared {
    NetworkFrame frame;
    DepthImage small;   // network size, the frame's orientation
    DepthImage turned;  // what the network sees
  };
  /// Labels and confidences of equally large prepared frames, in the network's orientation.
  std::vector<SegmentationResult> Forward(const std::vector<const Prepared*>& batch);

  at::Device device_;
  LoadedModel model_;
  std::string file_, sha256_;
};

std::vector<SegmentationResult> TorchSegmenter::Forward(const std::vector<const Prepared*>& batch) {
  const int width = batch.front()->turned.width(), height = batch.front()->turned.height();
  std::vector<at::Tensor> depths;
  depths.reserve(batch.size());
  for (const Prepared* item : batch) {
    depths.push_back(at::from_blob(const_cast<float*>(item->turned.data()), {1, 1, height, width},
                                   at::TensorOptions(at::kFloat)));
  }
  const c10::NoGradGuard no_grad;
  const at::Tensor input = EncodeDepth(at::cat(depths).to(device_), model_.meta.network.input)
                               .contiguous(at::MemoryFormat::ChannelsLast);
  const at::Tensor log_probabilities = model_.net->forward(input);  // [B,K,H,W]
  const auto [best, winner] = log_probabilities.max(1);             // [B,H,W]
  const at::Tensor confidence = best.exp().cpu().contiguous();
  const at::Tensor labels = winner.to(at::kByte).cpu().contiguous();

  std::vector<SegmentationResult> results;
  const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  for (std::size_t i = 0; i < batch.size(); ++i) {
    SegmentationResult result{LabelImage(width, height), Image<float>(width, height)};
    std::copy_n(labels.data_ptr<std::uint8_t>() + i * pixels, pixels, result.labels.begin());
    std::copy_n(confidence.data_ptr<float>() + i * pixels, pixels, result.confidence.begin());
    results.push_back(std::move(result));
  }
  return results;
}

std::vector<SegmentationResult> TorchSegmenter::Segment(
    const std::vector<SegmentationRequest>& requests) {
  std::vector<Prepared> prepared(requests.size());
  std::map<std::pair<int, int>, std::vector<std::size_t>> by_size;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const SegmentationRequest& request = requests[i];
    Prepared& item = prepared[i];
    item.frame = PlanNetworkFrame(*request.intrinsics, model_.meta.focal_px);
    item.small = ResampleDepth(*request.depth, item.frame);
    item.turned = Turn(item.small, request.quarter_turns);
    by_size[{item.turned.width(), item.turned.height()}].push_back(i);
  }
  std::vector<SegmentationResult> results(requests.size());
  for (const auto& [size, members] : by_size) {
    for (std::size_t begin = 0; begin < members.size(); begin += kBatch) {
      const std::size_t end = std::min(begin + kBatch, members.size());
      std::vector<const Prepared*> batch;
      for (std::size_t j = begin; j < end; ++j) batch.push_back(&prepared[members[j]]);
      const std::vector<SegmentationResult> seen = Forward(batch);
      for (std::size_t j = begin; j < end; ++j) {
        const std::size_t i = members[j];
        const int back = -requests[i].quarter_turns;
        results[i] = RestoreSegmentation(*requests[i].depth, prepared[i].small,
                                         Turn(seen[j - begin].labels, back),
                                         Turn(seen[j - begin].confidence, back), prepared[i].frame);
      }
    }
  }
  return results;
}

}  // namespace

std::unique_ptr<NetworkSegmenter> LoadNetworkSegmenter(const std::filesystem::path& checkpoint,
                                                       const Structure* structure,
                                                       const std::string& device) {
  return std::make_unique<TorchSegmenter>(checkpoint, structure, ParseDevice("device", device));
}

}  // namespace volalign
