#define VOLALIGN_SIMD avx512_winograd
#define VOLALIGN_VALUE float
#include "core/nn/simd/winograd_kernels.inc"
