#define VOLALIGN_SIMD avx2
#include "core/simd/map_kernels.inc"
