#define VOLALIGN_SIMD avx2
#include "core/nn/simd/map_kernels.inc"
