#pragma once

#include <c10/core/Device.h>

#include <string>

namespace volalign {

/// What a network runs on: cpu, cuda or cuda:N. `key` is the option that said so. Throws
/// ConfigError for another name and for a device that this LibTorch does not have.
at::Device ParseDevice(const std::string& key, const std::string& name);

}  // namespace volalign
