#define VOLALIGN_SET avx512
#include "render/noise_kernels.inc"
