#include "infer/view/network_segmenter.h"

#include <algorithm>
#include <map>
#include <utility>

#include "infer/view/network_frame.h"

namespace volalign {

namespace {

/// Most frames that go through the network together, to bound the memory of a pass.
constexpr std::size_t kBatch = 8;

struct Prepared {
  NetworkFrame frame;
  DepthImage small;   // network size, the frame's orientation
  DepthImage turned;  // what the network sees
};

}  // namespace

NetworkSegmenter::NetworkSegmenter(NetworkDescription description)
    : description_(std::move(description)) {}

std::vector<SegmentationResult> NetworkSegmenter::Segment(
    const std::vector<SegmentationRequest>& requests) {
  std::vector<Prepared> prepared(requests.size());
  std::map<std::pair<int, int>, std::vector<std::size_t>> by_size;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const SegmentationRequest& request = requests[i];
    Prepared& item = prepared[i];
    item.frame = PlanNetworkFrame(*request.intrinsics, description_.focal_px);
    item.small = ResampleDepth(*request.depth, item.frame);
    item.turned = Turn(item.small, request.quarter_turns);
    by_size[{item.turned.width(), item.turned.height()}].push_back(i);
  }
  std::vector<SegmentationResult> results(requests.size());
  for (const auto& [size, members] : by_size) {
    for (std::size_t begin = 0; begin < members.size(); begin += kBatch) {
      const std::size_t end = std::min(begin + kBatch, members.size());
      std::vector<const DepthImage*> batch;
      for (std::size_t j = begin; j < end; ++j) batch.push_back(&prepared[members[j]].turned);
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

}  // namespace volalign
