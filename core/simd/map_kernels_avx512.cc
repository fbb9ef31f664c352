#define VOLALIGN_SIMD avx512
#include "core/simd/map_kernels.inc"
