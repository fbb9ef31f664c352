#pragma once

#include <c10/core/Device.h>

#include <string>

namespace volalign {

/// The device of a network: cpu, cuda or cuda:N. `key` is the option that gave the name. Throws
/// ConfigError for another name and for a device that this LibTorch does not have.
at::Device ParseDevice(const std::string& key, const std::string& name);

/// Does cuDNN convolve in bfloat16 on this CUDA device? It does from compute capability 8.0 on.
/// False for the CPU.
bool ConvolvesInBf16(const at::Device& device);

}  // namespace volalign
