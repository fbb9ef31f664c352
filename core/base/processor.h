#pragma once

namespace volalign {

/// Instruction sets of this processor for which kernels exist.
struct Processor {
  bool avx2 = false;    ///< with fused multiplication and addition
  bool avx512 = false;  ///< F, BW, DQ and VL
  bool avx512_bf16 = false;
  bool amx_bf16 = false;
};

/// All false on other processors than x86-64.
const Processor& ThisProcessor();

}  // namespace volalign
