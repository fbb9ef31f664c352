#!/usr/bin/env bash
# Runs tests with assertions, address sanitizer and undefined-behaviour sanitizer (preset asan: clang 14, build/asan).
#   tests/long/sanitize.sh                       the whole suite
#   tests/long/sanitize.sh core infer/formats    the quick tests of these folders; builds no more than they need
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh

install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_SANITIZER_PACKAGES[@]}"
export ASAN_SYMBOLIZER_PATH=/usr/lib/llvm-14/bin/llvm-symbolizer
python=/usr/bin/python3
options=(-DPython3_EXECUTABLE="$python" -DPython_EXECUTABLE="$python")
if [ $# -eq 0 ]; then
  build_preset asan "${options[@]}" all
  ctest --preset asan -LE "$(tests/missing.sh "$python")"
else
  targets=("${@/#/quick_tests_}")
  build_preset asan "${options[@]}" "${targets[@]//\//_}"
  modules=$(IFS='|'; echo "$*")
  ctest --preset asan -L quick -LE "$(tests/missing.sh "$python")" -R "^($modules)/"
fi
