#include "train/compute.h"

#include <fmt/format.h>
#include <sched.h>
#include <torch/cuda.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <sstream>
#include <string>
#include <system_error>
#include <thread>
#include <vector>
#if defined(__GLIBC__)
#include <malloc.h>
#endif
#if defined(__aarch64__)
#include <asm/hwcap.h>
#include <sys/auxv.h>
#endif

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/processor.h"
#include "core/nn/torch_device.h"
#include "train/distributed/launch.h"

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

at::Device DeviceOf(const at::Device& device, const World& world, int visible) {
  if (!device.is_cuda() || device.has_index() || world.size == 1) return device;
  return {device.type(), static_cast<c10::DeviceIndex>(world.local_rank % std::max(visible, 1))};
}

Compute ChooseCompute(const RunConfig& run, const World& world) {
  const at::Device device = DeviceOf(ParseDevice("run.device", run.device), world,
                                     static_cast<int>(torch::cuda::device_count()));
  return DecideCompute(run, device, {ProcessorHasBf16(), ConvolvesInBf16(device)});
}

namespace {

/// Idle and total clock ticks of all processors, and the number of processors.
struct Ticks {
  double idle = 0, all = 0;
  int processors = 0;
};

Ticks ReadTicks(const std::string& stat) {
  Ticks ticks;
  std::istringstream lines(stat);
  for (std::string line; std::getline(lines, line) && line.rfind("cpu", 0) == 0;) {
    std::istringstream words(line);
    std::string name;
    words >> name;
    if (name != "cpu") {
      ++ticks.processors;
      continue;
    }
    double value = 0;
    for (int i = 0; i < 8 && words >> value; ++i) {  // later values are parts of these
      ticks.all += value;
      if (i == 3 || i == 4) ticks.idle += value;  // idle, and waiting for a disk
    }
  }
  if (ticks.processors == 0 || ticks.all == 0) throw DataError("/proc/stat has no processor");
  return ticks;
}

}  // namespace

int IdleProcessors(const std::string& before, const std::string& after, int allowed) {
  const Ticks a = ReadTicks(before), b = ReadTicks(after);
  if (b.all <= a.all) return allowed;
  const double idle = b.processors * (b.idle - a.idle) / (b.all - a.all);
  return std::clamp(static_cast<int>(std::lround(idle)), 1, std::max(allowed, 1));
}

int WithinQuota(const std::string& cpu_max, int processors) {
  double quota = 0, period = 0;
  if (!(std::istringstream(cpu_max) >> quota >> period) || period <= 0) return processors;
  return std::clamp(static_cast<int>(std::ceil(quota / period)), 1, std::max(processors, 1));
}

int IdleProcessors() {
  int allowed = static_cast<int>(std::thread::hardware_concurrency());
  if (cpu_set_t own; ::sched_getaffinity(0, sizeof(own), &own) == 0) allowed = CPU_COUNT(&own);
  constexpr const char *kStat = "/proc/stat", *kQuota = "/sys/fs/cgroup/cpu.max";
  if (std::filesystem::exists(kQuota))
    allowed = WithinQuota(ReadFile(kQuota, kMaxTextBytes), allowed);
  if (!std::filesystem::exists(kStat)) return std::max(allowed, 1);
  const std::string before = ReadFile(kStat, kMaxTextBytes);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  return IdleProcessors(before, ReadFile(kStat, kMaxTextBytes), allowed);
}

void KeepFreedMemory() {
#if defined(__GLIBC__)
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

void WaitPassively() {
  constexpr const char *kPolicy = "OMP_WAIT_POLICY", *kMatrixThreads = "OPENBLAS_NUM_THREADS";
  if (std::getenv(kPolicy) != nullptr && std::getenv(kMatrixThreads) != nullptr) return;
  std::error_code unknown;
  const std::string program = std::filesystem::read_symlink("/proc/self/exe", unknown).string();
  std::vector<std::string> command = OwnCommand();
  std::vector<char*> arguments;
  for (std::string& argument : command) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  // If it cannot be started again, it continues.
  constexpr int kKeep = 0;
  if (setenv(kPolicy, "PASSIVE", kKeep) == 0 && setenv(kMatrixThreads, "1", kKeep) == 0)
    execv(program.c_str(), arguments.data());
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
