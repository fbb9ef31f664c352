#define VOLALIGN_SET baseline
#define VOLALIGN_LANES 4
#include "render/tiles/tile_kernels.inc"
