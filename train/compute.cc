#include "train/compute.h"

#include <fmt/format.h>
#include <torch/cuda.h>

#include <limits>
#include <string>
#if defined(__GLIBC__)
#include <malloc.h>
#endif
#if defined(__aarch64__)
#include <asm/hwcap.h>
#include <sys/auxv.h>
#endif

#include "core/base/processor.h"
#include "core/nn/torch_device.h"

namespace volalign {

bool ProcessorHasBf16() {
#if defined(__x86_64__)
  return ThisProcessor().avx512_bf16;
#elif defined(__aarch64__) && defined(HWCAP2_BF16)
  return (getauxval(AT_HWCAP2) & HWCAP2_BF16) != 0;
#else
  return false;
#endif
}

Compute ChooseCompute(const RunConfig& run, const World& world) {
  Compute compute;
  compute.device = ParseDevice("run.device", run.device);
  if (compute.device.is_cuda() && !compute.device.has_index() && world.size > 1) {
    compute.device.set_index(static_cast<c10::DeviceIndex>(world.local_rank));
  }
  const bool bf16 = run.precision == Precision::kAuto
                        ? compute.device.is_cpu() && ProcessorHasBf16()
                        : run.precision == Precision::kBf16;
  compute.type = bf16 ? at::kBFloat16 : at::kFloat;
  compute.channels_last = run.channels_last == Layout::kAuto
                              ? compute.device.is_cpu() || bf16
                              : run.channels_last == Layout::kChannelsLast;
  return compute;
}

void KeepFreedMemory() {
#if defined(__GLIBC__)
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

std::string ToString(const Compute& compute) {
  return fmt::format("{}, {}, {}", compute.device.str(),
                     compute.type == at::kBFloat16 ? "bf16" : "fp32",
                     compute.channels_last ? "channels last" : "channels first");
}

at::Tensor EncodeFor(const Compute& compute, const at::Tensor& depth, InputEncoding input) {
  const at::Tensor encoded = EncodeDepth(depth, input);
  return compute.channels_last ? encoded.contiguous(at::MemoryFormat::ChannelsLast) : encoded;
}

void Synchronize(const at::Device& device) {
  if (device.is_cuda()) torch::cuda::synchronize(device.index());
}

}  // namespace volalign
