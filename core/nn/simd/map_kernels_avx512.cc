#define VOLALIGN_SIMD avx512
#include "core/nn/simd/map_kernels.inc"
