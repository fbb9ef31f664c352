#include "train/batch.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/stack.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "core/base/error.h"
#include "core/geometry/lens.h"

namespace volalign {
namespace {

/// As in the rounding of depth to millimetres (render/noise.cc) and the multiplication in
/// Unpack.
constexpr float kMillimetre = 0.001F;

void RequireSize(const Sample& s, int width, int height) {
  if (s.depth.width() == width && s.depth.height() == height && s.labels.width() == width &&
      s.labels.height() == height && s.intrinsics.width == width && s.intrinsics.height == height) {
    return;
  }
  throw Error(fmt::format("sample {} is {}x{} in a batch of {}x{}", s.index, s.depth.width(),
                          s.depth.height(), width, height));
}

/// False if a depth is no whole number of millimetres within int16. Numbers are compared by their
/// bits, which have vector instructions everywhere.
bool CopyMillimetres(const float* depth, std::size_t count, std::int16_t* out) {
  constexpr float kMost = 32.767F;
  std::uint32_t most = 0, differ = 0;
  std::memcpy(&most, &kMost, sizeof most);
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t bits = 0, again = 0;
    std::memcpy(&bits, depth + i, sizeof bits);
    // Bits of negative and larger numbers and of NaN are larger.
    const std::uint32_t clamped = std::min(bits, most);
    float metres = 0;
    std::memcpy(&metres, &clamped, sizeof metres);
    // It is not negative; lround would be a call per pixel.
    const int mm = static_cast<int>(metres * 1000 + 0.5F);  // NOLINT(bugprone-incorrect-roundings)
    const float rounded = static_cast<float>(mm) * kMillimetre;
    std::memcpy(&again, &rounded, sizeof again);
    out[i] = static_cast<std::int16_t>(mm);
    differ |= bits ^ again;
  }
  return differ == 0;
}

template <class T>
void ClearWithoutRay(const std::vector<std::uint8_t>& has_ray, T* depth) {
  for (std::size_t i = 0; i < has_ray.size(); ++i) {
    if (has_ray[i] == 0) depth[i] = 0;
  }
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

PackedBatch BatchPacker::Pack(const std::vector<Sample>& samples) {
  if (samples.empty()) throw Error("a batch needs at least one sample");
  const std::int64_t n = static_cast<std::int64_t>(samples.size());
  const int width = samples[0].depth.width(), height = samples[0].depth.height();
  const std::size_t pixels = samples[0].depth.size();
  const auto images = [&](at::IntArrayRef sizes, at::ScalarType type) {
    return at::empty(sizes, at::TensorOptions(type).pinned_memory(!device_.is_cpu()));
  };
  PackedBatch packed;
  packed.labels = images({n, height, width}, at::kByte);
  packed.depth = images({n, 1, height, width}, at::kShort);
  std::uint8_t* labels = packed.labels.data_ptr<std::uint8_t>();
  auto* millimetres = packed.depth.data_ptr<std::int16_t>();
  bool exact = true;
  for (const Sample& s : samples) {
    RequireSize(s, width, height);
    const Camera& camera = Of(s.intrinsics);
    packed.cameras.push_back(s.intrinsics);
    packed.rays.push_back(camera.rays);
    labels = std::copy(s.labels.begin(), s.labels.end(), labels);
    exact = exact && CopyMillimetres(s.depth.data(), pixels, millimetres);
    ClearWithoutRay(camera.has_ray, millimetres);
    millimetres += pixels;
  }
  if (exact) return packed;
  packed.depth = images({n, 1, height, width}, at::kFloat);
  auto* metres = packed.depth.data_ptr<float>();
  for (const Sample& s : samples) {
    std::copy(s.depth.begin(), s.depth.end(), metres);
    ClearWithoutRay(Of(s.intrinsics).has_ray, metres);
    metres += pixels;
  }
  return packed;
}

Batch Unpack(const PackedBatch& packed) {
  const at::Device device = packed.rays.at(0).device();
  Batch batch;
  batch.depth = packed.depth.to(device).to(at::kFloat);
  if (packed.depth.scalar_type() == at::kShort) batch.depth.mul_(kMillimetre);
  batch.labels = packed.labels.to(device).to(at::kLong);
  batch.rays = at::stack(packed.rays);
  return batch;
}

Batch Collate(const std::vector<Sample>& samples) {
  return Unpack(BatchPacker(at::kCPU).Pack(samples));
}

}  // namespace volalign
