#pragma once

/// Before a function of plain loops, which the compiler turns into vector instructions: compiles it
/// for several instruction sets. The program takes the best that the processor has. All give the
/// same result to the last bit, as no step is fused with another one. Such a function calls nothing
/// but VOLALIGN_INLINE functions and operators.
#if defined(__x86_64__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define VOLALIGN_CLONES \
  __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define VOLALIGN_CLONES
#endif
#define VOLALIGN_INLINE inline __attribute__((always_inline))
