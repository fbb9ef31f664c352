#pragma once

#include "core/base/processor.h"

namespace volalign {

/// Kernels for the instruction sets that this processor can run, the plainest first.
template <class Kernels>
struct KernelSets {
  Kernels sets[3];
  int count;
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
