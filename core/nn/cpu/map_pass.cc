#include "core/nn/cpu/map_pass.h"

#include <ATen/ops/empty.h>
#include <ATen/ops/zeros.h>

#include <algorithm>
#include <cmath>

namespace volalign {
namespace {

std::int32_t Nearest(std::int64_t i, std::int64_t from, std::int64_t to) {
  const float scale = static_cast<float>(from) / static_cast<float>(to);
  return static_cast<std::int32_t>(std::min<std::int64_t>(
      static_cast<std::int64_t>(std::floor(static_cast<float>(i) * scale)), from - 1));
}

}  // namespace

MapSize SizeOfMap(const at::Tensor& raw, bool phases) {
  if (!phases) return {raw.size(0), raw.size(1), raw.size(2), raw.size(3)};
  return {raw.size(0), raw.size(1) / 4, 2 * (raw.size(2) - 1), 2 * (raw.size(3) - 1)};
}

MaskGrid::MaskGrid(const at::Tensor& mask, const MapSize& size) {
  if (!mask.defined()) return;
  for (std::int64_t i = 0; i < size.height; ++i)
    row.push_back(Nearest(i, mask.size(2), size.height));
  for (std::int64_t i = 0; i < size.width; ++i)
    column.push_back(Nearest(i, mask.size(3), size.width));
}

simd::MapRows MapPass::Rows(std::int64_t sample) const {
  simd::MapRows m;
  m.width = size.width;
  m.channels = size.channels;
  m.phases = phases;
  m.relu = relu;
  m.raw = SampleData(raw, sample);
  m.raw_bf16 = IsBf16(raw);
  if (raw_gradient.defined()) m.raw_gradient = SampleData(raw_gradient, sample);
  if (map.defined()) {
    m.map = SampleData(map, sample);
    m.map_stride = map.stride(3);
    m.map_bf16 = IsBf16(map);
  }
  if (affine.a.defined()) {
    m.a = affine.a.data_ptr<float>() + sample * size.channels;
    m.b = affine.b.data_ptr<float>() + sample * size.channels;
  }
  if (mask.defined()) {
    m.mask = mask.data_ptr<float>() + sample * mask.stride(0);
    m.mask_row = grid.row.data();
    m.mask_column = grid.column.data();
    m.mask_width = mask.size(3);
  }
  if (pooled.defined()) {
    m.pooled = SampleData(pooled, sample);
    m.winner = reinterpret_cast<std::uint8_t*>(SampleData(winner, sample));
    m.pooled_height = pooled.size(2);
    m.pooled_width = pooled.size(3);
  }
  return m;
}

at::Tensor EmptyMap(const MapSize& size, std::int64_t channels, at::ScalarType type) {
  return at::empty({size.samples, channels, size.height, size.width},
                   at::TensorOptions(type).memory_format(at::MemoryFormat::ChannelsLast));
}

at::Tensor EvenlySpaced(const at::Tensor& x, bool dense) {
  const std::int64_t stride = x.stride(3);
  if (x.stride(1) == 1 && x.stride(2) == x.size(3) * stride &&
      x.stride(0) == x.size(2) * x.stride(2) &&
      (dense ? stride == x.size(1) : stride >= x.size(1))) {
    return x;
  }
  // By an empty tensor: contiguous(ChannelsLast) may keep strides of dimensions of size 1.
  at::Tensor copy =
      EmptyMap({x.size(0), x.size(1), x.size(2), x.size(3)}, x.size(1), x.scalar_type());
  copy.as_strided_(copy.sizes(),
                   {x.size(1) * x.size(2) * x.size(3), 1, x.size(3) * x.size(1), x.size(1)});
  return copy.copy_(x);
}

at::Tensor SumsOverMask(const at::Tensor& pixels, const at::Tensor& mask, const MaskGrid& grid) {
  at::Tensor result = at::zeros(mask.sizes(), at::kFloat);
  const auto in = pixels.accessor<float, 3>();
  auto out = result.accessor<float, 4>();
  for (std::int64_t s = 0; s < pixels.size(0); ++s) {
    for (std::int64_t y = 0; y < pixels.size(1); ++y) {
      auto row = out[s][0][grid.row[static_cast<std::size_t>(y)]];
      for (std::int64_t x = 0; x < pixels.size(2); ++x)
        row[grid.column[static_cast<std::size_t>(x)]] += in[s][y][x];
    }
  }
  return result;
}

}  // namespace volalign
