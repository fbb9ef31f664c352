#include "train/compute.h"

#include <fmt/format.h>
#include <torch/cuda.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <limits>
#include <string>
#include <system_error>
#include <vector>
#if defined(__GLIBC__)
#include <malloc.h>
#endif
#if defined(__aarch64__)
#include <asm/hwcap.h>
#include <sys/auxv.h>
#endif

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/processor.h"
#include "core/base/text.h"
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

Compute DecideCompute(const RunConfig& run, const at::Device& device, const Machine& machine) {
  const bool bf16 = run.precision == Precision::kAuto
                        ? (device.is_cpu() ? machine.processor_bf16 : machine.device_bf16)
                        : run.precision == Precision::kBf16;
  Compute compute;
  compute.device = device;
  compute.type = bf16 ? at::kBFloat16 : at::kFloat;
  compute.channels_last = run.channels_last == Layout::kAuto
                              ? device.is_cpu() || bf16
                              : run.channels_last == Layout::kChannelsLast;
  return compute;
}

Compute ChooseCompute(const RunConfig& run, const World& world) {
  at::Device device = ParseDevice("run.device", run.device);
  if (device.is_cuda() && !device.has_index() && world.size > 1) {
    device.set_index(static_cast<c10::DeviceIndex>(world.local_rank));
  }
  return DecideCompute(run, device, {ProcessorHasBf16(), ConvolvesInBf16(device)});
}

void KeepFreedMemory() {
#if defined(__GLIBC__)
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

void WaitPassively() {
  if (std::getenv("OMP_WAIT_POLICY") != nullptr) return;
  std::error_code unknown;
  const std::string program = std::filesystem::read_symlink("/proc/self/exe", unknown).string();
  std::vector<std::string> command = Split(ReadFile("/proc/self/cmdline", kMaxTextBytes), '\0');
  command.pop_back();  // what stands behind the last zero
  std::vector<char*> arguments;
  for (std::string& argument : command) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  // Where it cannot be started again it goes on as it is.
  if (setenv("OMP_WAIT_POLICY", "PASSIVE", 1) == 0) execv(program.c_str(), arguments.data());
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
