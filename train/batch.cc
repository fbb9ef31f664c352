#include "train/batch.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/stack.h>
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "core/base/error.h"
#include "core/base/ordered_prefetch.h"
#include "core/geometry/lens.h"

namespace volalign {
namespace {

void RequireSize(const Sample& s, int width, int height) {
  if (s.depth.width() == width && s.depth.height() == height && s.labels.width() == width &&
      s.labels.height() == height && s.intrinsics.width == width && s.intrinsics.height == height) {
    return;
  }
  throw Error(fmt::format("sample {} is {}x{} in a batch of {}x{}", s.index, s.depth.width(),
                          s.depth.height(), width, height));
}

}  // namespace

Batch Batch::Narrow(std::int64_t first, std::int64_t count) const {
  return {depth.narrow(0, first, count), labels.narrow(0, first, count),
          rays.narrow(0, first, count)};
}

const BatchPacker::Camera& BatchPacker::Of(const Intrinsics& intrinsics) {
  return cameras_.Get(intrinsics, [this](const Intrinsics& k) {
    const RayTable table = ComputeRays(k);
    const std::size_t pixels = table.rays.size();
    Camera camera{{}, at::empty({2, k.height, k.width}, at::kFloat)};
    float* rays = camera.rays.data_ptr<float>();
    for (std::size_t i = 0; i < pixels; ++i) {
      const bool has_ray = table.rays[i].allFinite();
      if (!has_ray && camera.has_ray.empty()) camera.has_ray.assign(pixels, 1);
      if (!has_ray) camera.has_ray[i] = 0;
      rays[i] = has_ray ? table.rays[i].x() : 0.0F;
      rays[pixels + i] = has_ray ? table.rays[i].y() : 0.0F;
    }
    camera.rays = camera.rays.to(device_);
    return camera;
  });
}

Batch BatchPacker::Pack(const std::vector<Sample>& samples) {
  if (samples.empty()) throw Error("a batch needs at least one sample");
  const std::int64_t n = static_cast<std::int64_t>(samples.size());
  const int width = samples[0].depth.width(), height = samples[0].depth.height();
  const auto images = [&](at::IntArrayRef sizes, at::ScalarType type) {
    return at::empty(sizes, at::TensorOptions(type).pinned_memory(!device_.is_cpu()));
  };
  Batch packed{
      images({n, 1, height, width}, at::kFloat), images({n, height, width}, at::kByte), {}};
  auto* depth = packed.depth.data_ptr<float>();
  auto* labels = packed.labels.data_ptr<std::uint8_t>();
  std::vector<at::Tensor> rays;
  for (const Sample& s : samples) {
    RequireSize(s, width, height);
    const Camera& camera = Of(s.intrinsics);
    packed.cameras.push_back(s.intrinsics);
    rays.push_back(camera.rays);
    labels = std::copy(s.labels.begin(), s.labels.end(), labels);
    std::copy(s.depth.begin(), s.depth.end(), depth);
    for (std::size_t i = 0; i < camera.has_ray.size(); ++i) {
      if (camera.has_ray[i] == 0) depth[i] = 0;
    }
    depth += s.depth.size();
  }
  packed.rays = at::stack(rays);
  return packed;
}

Batch Unpack(const Batch& packed) {
  const at::Device device = packed.rays.device();
  return {packed.depth.to(device, /*non_blocking=*/true),
          packed.labels.to(device, /*non_blocking=*/true).to(at::kLong), packed.rays,
          packed.cameras};
}

std::function<Batch()> FeedBatches(SampleSource source, const at::Device& device, int ahead) {
  const auto pack = [source = std::move(source), packer = std::make_shared<BatchPacker>(device)] {
    return packer->Pack(source());
  };
  if (ahead == 0) return [pack] { return Unpack(pack()); };
  OrderedPrefetch<Batch>::Options options;
  options.prefetch = ahead;
  const auto packed = std::make_shared<OrderedPrefetch<Batch>>(
      options, [pack] { return [pack](std::uint64_t) { return pack(); }; });
  return [packed] { return Unpack(packed->Take()); };
}

}  // namespace volalign
