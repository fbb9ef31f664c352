#include "core/nn/simd/winograd_kernels.h"

#include "core/base/processor.h"

namespace volalign::simd {

#if defined(__x86_64__)
namespace avx2_winograd {
WinogradKernels GetWinograd();
}
namespace avx512_winograd {
WinogradKernels GetWinograd();
}
namespace avx512bf16_winograd {
WinogradKernels GetWinograd();
}

// Each GetWinograd is compiled for its instruction set and called only if the processor has it.
const WinogradKernels* FindWinogradKernels(bool bf16) {
  const Processor& processor = ThisProcessor();
  if (bf16) {
    if (!processor.avx512_bf16 || processor.amx_bf16) return nullptr;
    static const WinogradKernels kernels = avx512bf16_winograd::GetWinograd();
    return &kernels;
  }
  if (processor.avx512) {
    static const WinogradKernels kernels = avx512_winograd::GetWinograd();
    return &kernels;
  }
  if (processor.avx2) {
    static const WinogradKernels kernels = avx2_winograd::GetWinograd();
    return &kernels;
  }
  return nullptr;
}
#else
const WinogradKernels* FindWinogradKernels(bool /*bf16*/) { return nullptr; }
#endif

}  // namespace volalign::simd
