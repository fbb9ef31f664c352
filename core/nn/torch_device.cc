#include "core/nn/torch_device.h"

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

}  // namespace volalign
