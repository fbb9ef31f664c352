#include "core/nn/simd/map_kernels.h"

#include "core/base/processor.h"

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
  if (ThisProcessor().avx512) return avx512::Get();
  if (ThisProcessor().avx2) return avx2::Get();
#endif
  return baseline::Get();
}

}  // namespace

const MapKernels& Kernels() {
  static const MapKernels kernels = Choose();
  return kernels;
}

}  // namespace volalign::simd
