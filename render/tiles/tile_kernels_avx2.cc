#define VOLALIGN_SET avx2
#define VOLALIGN_LANES 8
#include "render/tiles/tile_kernels.inc"
