#define VOLALIGN_SET avx512
#define VOLALIGN_LANES 16
#include "render/tiles/tile_kernels.inc"
