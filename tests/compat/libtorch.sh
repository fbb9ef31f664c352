#!/usr/bin/env bash
# Builds volalign with the LibTorch of PyPI's `torch` and runs the tests on the CPU:
#
#     tests/compat/libtorch.sh VERSION [CTEST ARGUMENT ...]      # for example 2.11.0, or `newest`
#
# A build that was interrupted is continued by the same command. CMAKE_ARGUMENTS=-DVOLALIGN_INFER=OFF leaves calibration out.
# The wheel goes into a virtual environment under build/libtorch/VERSION, the build into build/libtorch-VERSION. PyPI's wheel for
# x86-64 is the CUDA one, whose CMake package asks for a CUDA toolkit (nvcc on PATH, or CUDA_HOME); no GPU is needed. PIP_ARGUMENTS can
# name another index, for example PyTorch's own of CPU wheels, with which no toolkit is needed.
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh

version=${1:?usage: tests/compat/libtorch.sh VERSION [CTEST ARGUMENT ...]}
shift
python=${PYTHON:-python3}
environment=build/libtorch/$version
if ! "$environment/bin/python3" -c 'import torch' 2>/dev/null; then
  "$python" -m venv "$environment"
  wheel=torch==$version
  [ "$version" != newest ] || wheel=torch
  # shellcheck disable=SC2086  # several arguments
  "$environment/bin/pip" install --quiet ${PIP_ARGUMENTS:-} "$wheel" numpy
fi
prefix=$("$environment/bin/python3" -c 'import torch; print(torch.utils.cmake_prefix_path)')

# The preset `cuda` in a build folder of the wheel's own, with calibration and all tests: what they need and is missing is an error.
build=build/libtorch-$version
cmake --preset cuda -B "$build" -DCMAKE_PREFIX_PATH="$prefix" -DVOLALIGN_TESTS=ON -DVOLALIGN_INFER=ON \
  ${CMAKE_ARGUMENTS:-} >"$build.log" 2>&1 || { tail -n 20 "$build.log" >&2; exit 1; }
cmake --build "$build" --parallel "${JOBS:-2}"
"$environment/bin/python3" - <<'PYTHON'
import torch
print(f"LibTorch {torch.__version__}")
PYTHON
ctest --test-dir "$build" --output-on-failure --no-tests=error "$@"
