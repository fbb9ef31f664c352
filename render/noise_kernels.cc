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

namespace {

thread_local const NoiseKernels* on_this_thread = nullptr;

}  // namespace

const NoiseKernels& Kernels() {
  if (on_this_thread != nullptr) return *on_this_thread;
  static const NoiseKernels kernels = AllNoiseKernels().sets[AllNoiseKernels().count - 1];
  return kernels;
}

KernelsOnThisThread::KernelsOnThisThread(const NoiseKernels& kernels) { on_this_thread = &kernels; }

KernelsOnThisThread::~KernelsOnThisThread() { on_this_thread = nullptr; }

}  // namespace volalign::noise
