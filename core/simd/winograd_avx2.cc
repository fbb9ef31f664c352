#define VOLALIGN_SIMD avx2_winograd
#define VOLALIGN_VALUE float
#include "core/simd/winograd_kernels.inc"
