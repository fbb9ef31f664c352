#define VOLALIGN_SET avx2
#include "render/noise_kernels.inc"
