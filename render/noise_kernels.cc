#include "render/noise_kernels.h"

namespace volalign::noise {

namespace baseline {
NoiseKernels Get();
}
#if defined(__x86_64__)
namespace avx2 {
NoiseKernels Get();
}
namespace avx512 {
NoiseKernels Get();
}
#else
namespace avx2 = baseline;
namespace avx512 = baseline;
#endif

const KernelSets<NoiseKernels>& AllNoiseKernels() {
  static const KernelSets<NoiseKernels> all = CollectKernels(baseline::Get, avx2::Get, avx512::Get);
  return all;
}

const NoiseKernels& Kernels() {
  static const NoiseKernels kernels = AllNoiseKernels().sets[AllNoiseKernels().count - 1];
  return kernels;
}

}  // namespace volalign::noise
