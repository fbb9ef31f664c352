#define VOLALIGN_SET baseline
#include "render/noise_kernels.inc"
