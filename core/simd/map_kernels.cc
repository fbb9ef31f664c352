#include "core/simd/map_kernels.h"

namespace volalign::simd {

namespace baseline {
MapKernels Get();
}
#if defined(__x86_64__)
namespace avx2 {
MapKernels Get();
}
namespace avx512 {
MapKernels Get();
}
#endif

namespace {

MapKernels Choose() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
    return avx512::Get();
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2::Get();
#endif
  return baseline::Get();
}

}  // namespace

const MapKernels& Kernels() {
  static const MapKernels kernels = Choose();
  return kernels;
}

}  // namespace volalign::simd
