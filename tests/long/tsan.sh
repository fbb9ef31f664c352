#!/usr/bin/env bash
# Races between threads of the parts that have any.
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh
install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_SANITIZER_PACKAGES[@]}"
build_preset tsan quick_tests_core quick_tests_render quick_tests_train render_slow_tests infer_calib_slow_tests
ctest --preset tsan -LE "$(tests/missing.sh)" -R '^(core|render|train)/.*|^infer/calib/calibrate$' -L 'quick|slow'
