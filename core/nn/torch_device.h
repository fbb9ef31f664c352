#pragma once

#include <c10/core/Device.h>

#include <string>

namespace volalign {

/// What a network runs on: cpu, cuda or cuda:N. `key` is the option that said so. Throws
/// ConfigError for another name and for a device that this LibTorch does not have.
at::Device ParseDevice(const std::string& key, const std::string& name);

/// Whether cuDNN convolves in bfloat16 on this CUDA device: from compute capability 8.0 on. False
/// for the CPU.
bool ConvolvesInBf16(const at::Device& device);

}  // namespace volalign
