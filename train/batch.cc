#include "train/batch.h"

#include <ATen/ops/empty.h>
#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <utility>

#include "core/base/error.h"
#include "core/geometry/lens.h"

namespace volalign {

Batch Batch::To(const at::Device& device) const {
  return {depth.to(device), labels.to(device), rays.to(device)};
}

Batch Batch::Narrow(std::int64_t first, std::int64_t count) const {
  return {depth.narrow(0, first, count), labels.narrow(0, first, count),
          rays.narrow(0, first, count)};
}

namespace {

/// The rays of a batch's cameras, each computed once: a pool has few.
class RayTables {
 public:
  const RayTable& Of(const Intrinsics& intrinsics) {
    for (const auto& [known, table] : tables_) {
      if (known == intrinsics) return table;
    }
    return tables_.emplace_back(intrinsics, ComputeRays(intrinsics)).second;
  }

 private:
  std::deque<std::pair<Intrinsics, RayTable>> tables_;
};

void RequireSize(const Sample& s, int width, int height) {
  if (s.depth.width() == width && s.depth.height() == height && s.labels.width() == width &&
      s.labels.height() == height && s.intrinsics.width == width && s.intrinsics.height == height) {
    return;
  }
  throw Error(fmt::format("sample {} is {}x{} in a batch of {}x{}", s.index, s.depth.width(),
                          s.depth.height(), width, height));
}

}  // namespace

Batch Collate(const std::vector<Sample>& samples) {
  if (samples.empty()) throw Error("Collate needs at least one sample");
  const std::int64_t n = static_cast<std::int64_t>(samples.size());
  const int width = samples[0].depth.width(), height = samples[0].depth.height();
  Batch batch;
  batch.depth = at::empty({n, 1, height, width}, at::kFloat);
  batch.labels = at::empty({n, height, width}, at::kLong);
  batch.rays = at::empty({n, 2, height, width}, at::kFloat);
  float* depth = batch.depth.data_ptr<float>();
  std::int64_t* labels = batch.labels.data_ptr<std::int64_t>();
  float* rays = batch.rays.data_ptr<float>();
  RayTables tables;
  for (const Sample& s : samples) {
    RequireSize(s, width, height);
    labels = std::copy(s.labels.begin(), s.labels.end(), labels);
    const std::size_t pixels = s.depth.size();
    const std::vector<Eigen::Vector2f>& table = tables.Of(s.intrinsics).rays;
    for (std::size_t i = 0; i < pixels; ++i) {
      const bool has_ray = table[i].allFinite();
      *depth++ = has_ray ? s.depth[i] : 0.0F;
      rays[i] = has_ray ? table[i].x() : 0.0F;
      rays[pixels + i] = has_ray ? table[i].y() : 0.0F;
    }
    rays += 2 * pixels;
  }
  return batch;
}

}  // namespace volalign
