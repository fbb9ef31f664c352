#define VOLALIGN_SIMD baseline
#include "core/simd/map_kernels.inc"
