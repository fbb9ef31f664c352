#include "core/base/processor.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace volalign {
namespace {

Processor Ask() {
  Processor p;
#if defined(__x86_64__)
  p.avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  p.avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
             __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  p.avx512_bf16 = p.avx512 && __builtin_cpu_supports("avx512bf16");
  // GCC 12 has no name for it.
  unsigned eax = 0, ebx = 0, ecx = 0, edx = 0;
  p.amx_bf16 = __get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx) != 0 && (edx >> 22 & 1U) != 0;
#endif
  return p;
}

}  // namespace

const Processor& ThisProcessor() {
  static const Processor processor = Ask();
  return processor;
}

}  // namespace volalign
