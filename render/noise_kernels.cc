#include "render/noise_kernels.h"

#include "core/base/processor.h"

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
#endif

namespace {

NoiseKernelSets Collect() {
  NoiseKernelSets all{{baseline::Get()}, 1};
#if defined(__x86_64__)
  if (ThisProcessor().avx2) all.sets[all.count++] = avx2::Get();
  if (ThisProcessor().avx512) all.sets[all.count++] = avx512::Get();
#endif
  return all;
}

}  // namespace

const NoiseKernelSets& AllNoiseKernels() {
  static const NoiseKernelSets all = Collect();
  return all;
}

const NoiseKernels& Kernels() {
  static const NoiseKernels kernels = AllNoiseKernels().sets[AllNoiseKernels().count - 1];
  return kernels;
}

}  // namespace volalign::noise
