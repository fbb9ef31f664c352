#include "render/noise_kernels.h"

namespace volalign::noise {

VOLALIGN_DECLARE_KERNELS(NoiseKernels)

const KernelSets<NoiseKernels>& AllNoiseKernels() {
  static const KernelSets<NoiseKernels> all = CollectKernels(baseline::Get, avx2::Get, avx512::Get);
  return all;
}

namespace {

thread_local const NoiseKernels* on_this_thread = nullptr;

}  // namespace

const NoiseKernels& Kernels() {
  if (on_this_thread != nullptr) return *on_this_thread;
  return AllNoiseKernels().Best();
}

KernelsOnThisThread::KernelsOnThisThread(const NoiseKernels& kernels) { on_this_thread = &kernels; }

KernelsOnThisThread::~KernelsOnThisThread() { on_this_thread = nullptr; }

}  // namespace volalign::noise
