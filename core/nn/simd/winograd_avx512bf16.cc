#define VOLALIGN_SIMD avx512bf16_winograd
#define VOLALIGN_VALUE std::uint16_t
#include "core/nn/simd/winograd_kernels.inc"
