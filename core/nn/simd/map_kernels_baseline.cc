#define VOLALIGN_SIMD baseline
#include "core/nn/simd/map_kernels.inc"
