#pragma once

#include "core/base/processor.h"

namespace volalign {

/// Declares `Kernels Get()` in a namespace for each instruction set (volalign_kernels of
/// cmake/VolalignTargets.cmake).
#if defined(__x86_64__)
#define VOLALIGN_DECLARE_KERNELS(Kernels) \
  namespace baseline {                    \
  Kernels Get();                          \
  }                                       \
  namespace avx2 {                        \
  Kernels Get();                          \
  }                                       \
  namespace avx512 {                      \
  Kernels Get();                          \
  }
#else
#define VOLALIGN_DECLARE_KERNELS(Kernels) \
  namespace baseline {                    \
  Kernels Get();                          \
  }                                       \
  namespace avx2 = baseline;              \
  namespace avx512 = baseline;
#endif

/// Kernels for the instruction sets of this processor, the simplest first.
template <class Kernels>
struct KernelSets {
  Kernels sets[3];
  int count;

  const Kernels& Best() const { return sets[count - 1]; }
};

/// Calls those of these functions whose kernels this processor can run. Only for sources that are
/// compiled for every processor.
template <class Kernels>
KernelSets<Kernels> CollectKernels(Kernels (*baseline)(), Kernels (*avx2)(), Kernels (*avx512)()) {
  KernelSets<Kernels> all{{baseline()}, 1};
  if (ThisProcessor().avx2) all.sets[all.count++] = avx2();
  if (ThisProcessor().avx512) all.sets[all.count++] = avx512();
  return all;
}

}  // namespace volalign
