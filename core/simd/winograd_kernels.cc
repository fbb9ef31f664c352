#include "core/simd/winograd_kernels.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace volalign::simd {

#if defined(__x86_64__)
namespace avx2_winograd {
WinogradKernels GetWinograd();
}
namespace avx512_winograd {
WinogradKernels GetWinograd();
}
namespace avx512bf16_winograd {
WinogradKernels GetWinograd();
}

namespace {

bool HasAvx512() {
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
}

bool HasAmx() {
  unsigned eax = 0, ebx = 0, ecx = 0, edx = 0;
  return __get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx) != 0 && (edx >> 22 & 1U) != 0;
}

// Each GetWinograd is compiled for its instruction set and called only where the processor has it.
const WinogradKernels* ForFloat() {
  if (HasAvx512()) {
    static const WinogradKernels kernels = avx512_winograd::GetWinograd();
    return &kernels;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    static const WinogradKernels kernels = avx2_winograd::GetWinograd();
    return &kernels;
  }
  return nullptr;
}

const WinogradKernels* ForBf16() {
  if (!HasAvx512() || !__builtin_cpu_supports("avx512bf16") || HasAmx()) return nullptr;
  static const WinogradKernels kernels = avx512bf16_winograd::GetWinograd();
  return &kernels;
}

}  // namespace

const WinogradKernels* FindWinogradKernels(bool bf16) {
  // Asked once: in a virtual machine, cpuid takes as long as a small convolution.
  static const WinogradKernels* const of_float = ForFloat();
  static const WinogradKernels* const of_bf16 = ForBf16();
  return bf16 ? of_bf16 : of_float;
}
#else
const WinogradKernels* FindWinogradKernels(bool /*bf16*/) { return nullptr; }
#endif

}  // namespace volalign::simd
