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

/// What `auto` is decided by.
struct Machine {
  bool processor_bf16 = false;  ///< ProcessorHasBf16
  bool device_bf16 = false;     ///< the CUDA device convolves in bfloat16: compute capability 8
};

/// The type and layout of a run on `device`: `auto` is bfloat16 where there are instructions for
/// it, and channels-last on a CPU, whose kernels of core/nn/cpu want it, and on a CUDA device with
/// bfloat16, as its tensor cores read them.
Compute DecideCompute(const RunConfig& run, const at::Device& device, const Machine& machine);

/// `cuda` without a number, in a process of several, is the device of its local rank among the
/// `visible` ones; where each process sees devices of its own, there are fewer than local ranks.
at::Device DeviceOf(const at::Device& device, const World& world, int visible);

/// As run.device, run.precision and run.channels_last say; `auto` is decided for this machine, and
/// `cuda` without a number is that of DeviceOf. Throws ConfigError for a
/// device that this LibTorch does not have.
Compute ChooseCompute(const RunConfig& run, const World& world = World());

/// Whether this processor has instructions for bfloat16 that LibTorch uses. Without them bfloat16
/// takes longer than float32.
bool ProcessorHasBf16();

/// Processors that this process may use and nothing else does, at least 1: measured over a fifth of
/// a second. Threads of LibTorch that have to share a processor wait for each other most of the
/// time, above all in oneDNN's bfloat16 gradients, which spin while they wait.
int IdleProcessors();

/// The same of what /proc/stat says at two times, of `allowed` processors. Throws DataError for
/// another text.
int IdleProcessors(const std::string& before, const std::string& after, int allowed);

/// Of `processors` those that a container may use: the quota of cgroup v2's cpu.max, "200000
/// 100000" or "max 100000", rounded up.
int WithinQuota(const std::string& cpu_max, int processors);

/// From here on the process keeps the memory that it frees. glibc gives large blocks back to the
/// system, which hands them out again a page at a time and cleared: a tenth of a training step,
/// whose maps all have such blocks. The program's to decide, as SetTorchThreads.
void KeepFreedMemory();

/// From here on OpenMP's threads sleep while they wait for work, where OMP_WAIT_POLICY says nothing
/// else. By default they spin for a while, which takes from the other work of a shared processor
/// what the threads at work wait for. OpenMP reads that variable while it is loaded, so that the
/// program starts itself again, as it was called: to be called before it has done anything.
void WaitPassively();

/// "cpu, bf16, channels last".
std::string ToString(const Compute& compute);

/// The network's input of depth maps [B,1,H,W], in the layout of `compute`.
at::Tensor EncodeFor(const Compute& compute, const at::Tensor& depth, InputEncoding input);

/// Waits until the device has done what it was given, so that a clock measures it.
void Synchronize(const at::Device& device);

}  // namespace volalign
