#include "render/tiles/tile_kernels.h"

namespace volalign::tiles {

VOLALIGN_DECLARE_KERNELS(TileKernels)

const KernelSets<TileKernels>& AllKernels() {
  static const KernelSets<TileKernels> all = CollectKernels(baseline::Get, avx2::Get, avx512::Get);
  return all;
}

}  // namespace volalign::tiles
