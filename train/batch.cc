#include "train/batch.h"

#include <ATen/ops/empty.h>
#include <fmt/format.h>

#include <algorithm>

#include "core/error.h"

namespace volalign {
Batch Batch::To(const at::Device& device) const {
  return {depth.to(device), labels.to(device), intrinsics.to(device)};
}

Batch Collate(const std::vector<Sample>& samples) {
  if (samples.empty()) throw Error("Collate needs at least one sample");
  const std::int64_t n = static_cast<std::int64_t>(samples.size());
  const int width = samples[0].depth.width(), height = samples[0].depth.height();
  Batch batch;
  batch.depth = at::empty({n, 1, height, width}, at::kFloat);
  batch.labels = at::empty({n, height, width}, at::kLong);
  batch.intrinsics = at::empty({n, 4}, at::kFloat);
  float* depth = batch.depth.data_ptr<float>();
  std::int64_t* labels = batch.labels.data_ptr<std::int64_t>();
  float* intrinsics = batch.intrinsics.data_ptr<float>();
  for (const Sample& s : samples) {
    if (s.depth.width() != width || s.depth.height() != height || s.labels.width() != width ||
        s.labels.height() != height) {
      throw Error(fmt::format("sample {} is {}x{} in a batch of {}x{}", s.index, s.depth.width(),
                              s.depth.height(), width, height));
    }
    depth = std::copy(s.depth.begin(), s.depth.end(), depth);
    labels = std::copy(s.labels.begin(), s.labels.end(), labels);
    for (double k : {s.intrinsics.fx, s.intrinsics.fy, s.intrinsics.cx, s.intrinsics.cy}) {
      *intrinsics++ = static_cast<float>(k);
    }
  }
  return batch;
}

}  // namespace volalign
