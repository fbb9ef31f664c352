#include "core/nn/torch_device.h"

#include <ATen/detail/CUDAHooksInterface.h>
#include <c10/core/DeviceGuard.h>
#include <fmt/format.h>
#include <torch/cuda.h>

#include "core/base/error.h"

namespace volalign {

at::Device ParseDevice(const std::string& key, const std::string& name) {
  at::Device device(at::kCPU);
  try {
    device = at::Device(name);
  } catch (const std::exception&) {
    throw ConfigError(fmt::format("{} = '{}' is no device: use cpu, cuda or cuda:N", key, name));
  }
  if (!device.is_cpu() && !device.is_cuda()) {
    throw ConfigError(fmt::format("{} = '{}' is no device: use cpu, cuda or cuda:N", key, name));
  }
  if (device.is_cuda() && !torch::cuda::is_available()) {
    throw ConfigError(
        fmt::format("{0} = '{1}': this LibTorch finds no CUDA device: use {0} = cpu", key, name));
  }
  return device;
}

bool ConvolvesInBf16(const at::Device& device) {
  if (!device.is_cuda()) return false;
  const c10::DeviceGuard guard(device);
  return at::detail::getCUDAHooks().supportsBFloat16ConvolutionWithCuDNNv8();
}

}  // namespace volalign
