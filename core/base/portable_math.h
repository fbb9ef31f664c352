#pragma once

namespace volalign {

/// Functions with the same bits on every IEEE-754 machine, for what has to be exactly reproducible
/// (sensor poses of training samples). The C library's sine and cosine are no such functions: glibc
/// picks variants by the processor, and those with and without fused multiply-add differ in the
/// last bit of about one value in 1400. The build's -ffp-contract=off (cmake/VolalignTargets.cmake)
/// is part of the promise.
struct SinCos {
  double sin = 0;
  double cos = 1;
};
/// Within 2.3e-16 of the exact values for |angle| <= 1e5 rad; throws Error beyond, and for NaN.
SinCos PortableSinCos(double angle);

/// Cube root, within 1e-15 of it relatively; `x` >= 0 and finite, else Error.
double PortableCbrt(double x);

}  // namespace volalign
