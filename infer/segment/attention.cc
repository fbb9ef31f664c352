#include "infer/segment/attention.h"

#include <ATen/ops/from_blob.h>
#include <ATen/ops/upsample_nearest2d.h>
#include <c10/core/GradMode.h>

#include <algorithm>

#include "core/nn/checkpoint.h"
#include "core/nn/network.h"
#include "infer/view/network_frame.h"

namespace volalign {

namespace {

/// The attention of a frame in the network's size and orientation.
Image<float> AttentionOf(LoadedModel& model, const DepthImage& depth) {
  const int width = depth.width(), height = depth.height();
  const at::Tensor frame = at::from_blob(const_cast<float*>(depth.data()), {1, 1, height, width},
                                         at::TensorOptions(at::kFloat));
  const NetworkOutput output =
      model.net->ForwardWithAttention(EncodeDepth(frame, model.meta.network.input));
  const at::Tensor enlarged =
      at::upsample_nearest2d(output.attention, {height, width}).contiguous();  // [1,1,H,W]
  Image<float> map(width, height);
  std::copy_n(enlarged.data_ptr<float>(), map.size(), map.begin());
  return map;
}

}  // namespace

std::vector<Image<float>> AttentionMaps(const std::filesystem::path& checkpoint,
                                        const std::vector<SegmentationRequest>& requests) {
  const c10::NoGradGuard no_grad;
  LoadedModel model = LoadCheckpoint(checkpoint);
  std::vector<Image<float>> maps(requests.size());
  if (!model.meta.network.attention) return maps;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const SegmentationRequest& request = requests[i];
    const NetworkFrame frame = PlanNetworkFrame(*request.intrinsics, model.meta.focal_px);
    const DepthImage turned = Turn(ResampleDepth(*request.depth, frame), request.quarter_turns);
    maps[i] = RestoreMap(Turn(AttentionOf(model, turned), -request.quarter_turns),
                         request.depth->width(), request.depth->height(), frame);
  }
  return maps;
}

}  // namespace volalign
