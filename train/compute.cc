#include "train/compute.h"

#include <fmt/format.h>
#include <torch/cuda.h>

#include <string>

#include "core/error.h"

namespace volalign {
namespace {

at::Device ParseDevice(const std::string& name) {
  at::Device device(at::kCPU);
  try {
    device = at::Device(name);
  } catch (const std::exception&) {
    throw ConfigError(fmt::format("run.device = '{}' is no device: use cpu, cuda or cuda:N", name));
  }
  if (!device.is_cpu() && !device.is_cuda()) {
    throw ConfigError(fmt::format("run.device = '{}' is no device: use cpu, cuda or cuda:N", name));
  }
  if (device.is_cuda() && !torch::cuda::is_available()) {
    throw ConfigError(fmt::format(
        "run.device = '{}': this LibTorch finds no CUDA device: use run.device = cpu", name));
  }
  return device;
}

}  // namespace

Compute ChooseCompute(const RunConfig& run) {
  Compute compute;
  compute.device = ParseDevice(run.device);
  compute.type = run.precision == "bf16" ? at::kBFloat16 : at::kFloat;
  compute.channels_last = run.channels_last;
  return compute;
}

at::Tensor EncodeFor(const Compute& compute, const at::Tensor& depth, InputEncoding input) {
  const at::Tensor encoded = EncodeDepth(depth, input);
  return compute.channels_last ? encoded.contiguous(at::MemoryFormat::ChannelsLast) : encoded;
}

void Synchronize(const at::Device& device) {
  if (device.is_cuda()) torch::cuda::synchronize(device.index());
}

}  // namespace volalign
