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

}  // namespace

const WinogradKernels* FindWinogradKernels(bool bf16) {
  static const WinogradKernels of_avx2 = avx2_winograd::GetWinograd(),
                               of_avx512 = avx512_winograd::GetWinograd(),
                               of_bf16 = avx512bf16_winograd::GetWinograd();
  if (bf16) {
    const bool suits = HasAvx512() && __builtin_cpu_supports("avx512bf16") && !HasAmx();
    return suits ? &of_bf16 : nullptr;
  }
  if (HasAvx512()) return &of_avx512;
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? &of_avx2 : nullptr;
}
#else
const WinogradKernels* FindWinogradKernels(bool /*bf16*/) { return nullptr; }
#endif

}  // namespace volalign::simd
