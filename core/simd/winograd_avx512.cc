#define VOLALIGN_SIMD avx512_winograd
#define VOLALIGN_VALUE float
#include "core/simd/winograd_kernels.inc"
