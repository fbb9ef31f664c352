#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "core/nn/network.h"
#include "train/distributed/world.h"
#include "train/train_config.h"

namespace volalign {

/// On what, in which type and in which memory layout a run computes.
struct Compute {
  at::Device device{at::kCPU};
  at::ScalarType type = at::kFloat;  ///< StructureNetImpl::SetComputeType
  bool channels_last = false;
};

/// As run.device, run.precision and run.channels_last say; `auto` is decided for this machine, and
/// `cuda` without a number is the device of the process's local rank. Throws ConfigError for a
/// device that this LibTorch does not have.
Compute ChooseCompute(const RunConfig& run, const World& world = World());

/// Whether this processor has instructions for bfloat16 that LibTorch uses. Without them bfloat16
/// takes longer than float32.
bool ProcessorHasBf16();

/// From here on the process keeps the memory that it frees. glibc gives large blocks back to the
/// system, which hands them out again a page at a time and cleared: a tenth of a training step,
/// whose maps all have such blocks. The program's to decide, as SetTorchThreads.
void KeepFreedMemory();

/// "cpu, bf16, channels last".
std::string ToString(const Compute& compute);

/// The network's input of depth maps [B,1,H,W], in the layout of `compute`.
at::Tensor EncodeFor(const Compute& compute, const at::Tensor& depth, InputEncoding input);

/// Waits until the device has done what it was given, so that a clock measures it.
void Synchronize(const at::Device& device);

}  // namespace volalign
