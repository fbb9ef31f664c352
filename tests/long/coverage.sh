#!/usr/bin/env bash
# Lines of each module that ran in the quick and slow tests of the four libraries.
set -euo pipefail
cd "$(dirname "$0")/../.."
source cmake/packages.sh
install_packages "${VOLALIGN_BUILD_PACKAGES[@]}" "${VOLALIGN_TEST_PACKAGES[@]}" "${VOLALIGN_SANITIZER_PACKAGES[@]}"
build_preset coverage all
rm -rf build/coverage/profiles
ctest --preset coverage -LE "$(tests/missing.sh)" -R '^(core|render|train|infer)/'
llvm-profdata-14 merge -o build/coverage/all.profdata build/coverage/profiles/*.profraw
mapfile -t programs < <(find build/coverage/tests -name '*_tests' -type f -printf '-object\n%p\n')
llvm-cov-14 export -summary-only -instr-profile build/coverage/all.profdata "${programs[@]:1}" >build/coverage/lines.json
tests/long/coverage_table.py build/coverage/lines.json
