#define VOLALIGN_SIMD avx2_winograd
#define VOLALIGN_VALUE float
#include "core/nn/simd/winograd_kernels.inc"
