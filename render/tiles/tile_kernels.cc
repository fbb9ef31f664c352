#include "render/tiles/tile_kernels.h"

#include "core/base/processor.h"

namespace volalign::tiles {

namespace baseline {
TileKernels Get();
}
#if defined(__x86_64__)
namespace avx2 {
TileKernels Get();
}
namespace avx512 {
TileKernels Get();
}
#endif

namespace {

KernelSets Collect() {
  KernelSets all{{baseline::Get()}, 1};
#if defined(__x86_64__)
  if (ThisProcessor().avx2) all.sets[all.count++] = avx2::Get();
  if (ThisProcessor().avx512) all.sets[all.count++] = avx512::Get();
#endif
  return all;
}

}  // namespace

const KernelSets& AllKernels() {
  static const KernelSets all = Collect();
  return all;
}

}  // namespace volalign::tiles
