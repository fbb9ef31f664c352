#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "core/nn/network.h"
#include "train/distributed/world.h"
#include "train/train_config.h"

namespace volalign {

/// Device, type and memory layout of a run.
struct Compute {
  at::Device device{at::kCPU};
  at::ScalarType type = at::kFloat;  ///< StructureNetImpl::SetComputeType
  bool channels_last = false;
};

/// The properties that decide `auto`.
struct Machine {
  bool processor_bf16 = false;  ///< ProcessorHasBf16
  bool device_bf16 = false;     ///< the CUDA device convolves in bfloat16: compute capability 8
};

/// The type and layout of a run on `device`. For the type, `auto` is bfloat16 if there are
/// instructions for it. For the layout, `auto` is channels-last on a CPU (for the kernels of
/// core/nn/cpu) and on a CUDA device with bfloat16 (for its tensor cores).
Compute DecideCompute(const RunConfig& run, const at::Device& device, const Machine& machine);

/// Resolves `cuda` without a number. In a process of several, it is the device of its local rank
/// among the `visible` ones. If each process sees only its own devices, there are fewer than local
/// ranks.
at::Device DeviceOf(const at::Device& device, const World& world, int visible);

/// The device, type and layout by run.device, run.precision and run.channels_last. `auto` is
/// decided for this machine; see DeviceOf for `cuda`. Throws ConfigError for a device that this
/// LibTorch does not have.
Compute ChooseCompute(const RunConfig& run, const World& world = World());

/// Has this processor instructions for bfloat16 that LibTorch uses? Without them, bfloat16 takes
/// longer than float32.
bool ProcessorHasBf16();

/// Number of idle processors that this process may use, at least 1, measured over a fifth of a
/// second. Threads of LibTorch that share a processor wait for each other most of the time, above
/// all in oneDNN's bfloat16 gradients, which spin while they wait.
int IdleProcessors();

/// The same from the content of /proc/stat at two times, for `allowed` processors. Throws DataError
/// for another text.
int IdleProcessors(const std::string& before, const std::string& after, int allowed);

/// The part of `processors` that a container may use, rounded up. `cpu_max` is the quota in cgroup
/// v2's cpu.max: "200000 100000" or "max 100000".
int WithinQuota(const std::string& cpu_max, int processors);

/// From now on the process keeps the memory that it frees. Otherwise glibc returns large blocks to
/// the system, which clears them again page by page. That takes a tenth of a training step and of a
/// calibration, as maps and images have such blocks. Called by the program, as SetTorchThreads.
void KeepFreedMemory();

/// From now on OpenMP's threads sleep while they wait for work, and OpenBLAS has no threads of its
/// own, unless OMP_WAIT_POLICY or OPENBLAS_NUM_THREADS says otherwise. By default OpenMP's spin for
/// a while, and OpenBLAS has a thread for each processor for any run.threads. Both slow the other
/// threads on a shared processor. The libraries read the variables while they are loaded. So the
/// program starts itself again with its arguments: call this before other work.
void WaitPassively();

/// "cpu, bf16, channels last".
std::string ToString(const Compute& compute);

/// The network's input for depth maps [B,1,H,W], in the layout of `compute`.
at::Tensor EncodeFor(const Compute& compute, const at::Tensor& depth, InputEncoding input);

/// Waits until the device has finished its work, so that a clock can measure it.
void Synchronize(const at::Device& device);

}  // namespace volalign
