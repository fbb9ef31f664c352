#include "render/tiles/tile_kernels.h"

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
#else
namespace avx2 = baseline;
namespace avx512 = baseline;
#endif

const KernelSets<TileKernels>& AllKernels() {
  static const KernelSets<TileKernels> all = CollectKernels(baseline::Get, avx2::Get, avx512::Get);
  return all;
}

}  // namespace volalign::tiles
